// SPDX-License-Identifier: MIT
// @ts-check
// Commands to the selected probe, with their results as toasts.

import { attempt, tell } from "./header.js";

/** @typedef {import("./model.js").Model} Model */

/**
 * Sends commands to the selected probe one after the other, and shows their results;
 * returns whether all were carried out.
 * @param {Model} model
 * @param {string} what
 * @param {[string, Record<string, string>][]} commands
 */
export async function run(model, what, commands) {
  const probe = model.selected;
  if (!probe || !model.mayCommand) {
    return false;
  }
  const isDone = await attempt(async () => {
    for (const [command, parameters] of commands) {
      await model.link.ask(probe, command, parameters);
    }
    tell(`${what}: done`);
    return true;
  }, what);
  return isDone === true;
}

/**
 * Sets the origin of the selected probe: "all" of it, or its "heading"; returns whether
 * it is set.
 * @param {Model} model
 * @param {string} what
 */
export async function setOrigin(model, what) {
  if (model.probe?.pose?.flags.includes("starting")) {
    tell("Set origin: wait until the probe has found level and north; an origin set now would be lost", true);
    return false;
  }
  return run(model, "Set origin", [["tare", { what }]]);
}
