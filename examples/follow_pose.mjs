// SPDX-License-Identifier: MIT
// Prints the poses of all probes, in a browser or Node 22: follow_pose.mjs [URL].

const url = globalThis.process?.argv[2] ?? "ws://127.0.0.1:8735/stream";
const socket = new WebSocket(url); // docs/subscribe.md has its messages
socket.onmessage = ({ data }) => {
  for (const line of data.split("\n").map((text) => JSON.parse(text))) {
    if (line.type === "stream" && line.version !== 1) socket.close();
    if (line.type === "pose") console.log(line.probe, ...line.q);
  }
};
socket.onerror = () => console.error(`no imud at ${url}`);
