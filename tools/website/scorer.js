// SPDX-License-Identifier: MIT
// How the search orders pages: by the scores of Sphinx, with guides before pages that
// say why and when.
const LATER = /^(docs\/decisions\/|CHANGELOG|CONTRIBUTING)/;

var Scorer = {
  score: ([page, , , , score]) => (LATER.test(page) ? score - 100 : score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
