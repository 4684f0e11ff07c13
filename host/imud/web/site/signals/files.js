// SPDX-License-Identifier: MIT
// @ts-check
// The visible data as a file: the rows of the window as CSV, the plots as PNG.

/** @typedef {import("./history.js").History} History */
/** @typedef {import("./chart.js").Chart} Chart */

/**
 * Rows of several histories in the order of their times. A cell is empty where that
 * history has no such row or the value is not known.
 * @param {{ history: History, columns: string[] }[]} parts
 * @param {{ from: number, to: number }} window
 */
export function csvOf(parts, { from, to }) {
  const names = parts.flatMap(({ columns }) => columns);
  const lines = [["time_utc", "t_s", ...names].join(",")];
  const places = parts.map(({ history }) => history.find(from));
  for (;;) {
    const times = parts.map(({ history }, index) =>
      places[index] < history.length ? history.time(places[index]) : Infinity,
    );
    const time = Math.min(...times);
    if (!(time <= to)) {
      return `${lines.join("\n")}\n`;
    }
    const cells = parts.flatMap(({ history, columns }, index) => {
      if (times[index] !== time) {
        return columns.map(() => "");
      }
      const row = places[index]++;
      return columns.map((name) => {
        const value = history.value(history.names.indexOf(name), row);
        return Number.isNaN(value) ? "" : String(Number(value.toPrecision(7)));
      });
    });
    lines.push([new Date(time * 1000).toISOString(), time.toFixed(6), ...cells].join(","));
  }
}

/**
 * All plots in one picture, with their titles.
 * @param {Chart[]} charts
 * @param {string} title
 * @returns {Promise<Blob>}
 */
export function pngOf(charts, title) {
  const style = getComputedStyle(document.documentElement);
  const pictures = charts.flatMap((chart) => (chart.picture ? [chart] : []));
  const scale = devicePixelRatio;
  const head = 28 * scale;
  const width = Math.max(1, ...pictures.map((chart) => chart.picture?.width ?? 0));
  const height = pictures.reduce((sum, one) => sum + head + (one.picture?.height ?? 0), head);
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = style.getPropertyValue("--surface");
  context.fillRect(0, 0, width, height);
  let top = 0;
  const write = (/** @type {string} */ text, /** @type {string} */ colour, x = 8) => {
    context.fillStyle = style.getPropertyValue(colour);
    context.fillText(text, x * scale, top + 19 * scale);
    return x + context.measureText(text).width / scale + 12;
  };
  context.font = `600 ${13 * scale}px system-ui, sans-serif`;
  write(title, "--ink");
  top += head;
  for (const { plot, picture } of pictures) {
    let x = write(`${plot.title}, ${plot.unit}`, "--muted");
    for (const [name, , colour] of plot.series) {
      x = write(name, `--${colour}`, x);
    }
    top += head;
    if (picture) {
      context.drawImage(picture, 0, top);
      top += picture.height;
    }
  }
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no picture"))));
  });
}
