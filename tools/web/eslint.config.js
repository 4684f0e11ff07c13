// SPDX-License-Identifier: MIT
// Rules for the page's own modules; what types can tell is left to TypeScript.
import js from "@eslint/js";

export default [
  js.configs.recommended,
  {
    files: ["**/*.js"],
    languageOptions: { ecmaVersion: 2024, sourceType: "module" },
    rules: {
      "no-undef": "off", // TypeScript knows the browser's names
      "no-unused-vars": ["error", { argsIgnorePattern: "^_" }],
      "no-var": "error",
      "prefer-const": "error",
      eqeqeq: ["error", "always", { null: "ignore" }],
      curly: "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "max-lines": ["error", 350],
      "max-lines-per-function": ["error", 80],
      "no-restricted-properties": [
        "error",
        { property: "innerHTML", message: "text is set as text: dom.js" },
        { property: "outerHTML", message: "text is set as text: dom.js" },
        { property: "insertAdjacentHTML", message: "text is set as text: dom.js" },
      ],
    },
  },
];
