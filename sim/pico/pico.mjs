// SPDX-License-Identifier: MIT
// The virtual Pico as a program: loads pico.c's library and gives it an RP2040.

import fs from "node:fs";
import path from "node:path";
import { fileURLToPath } from "node:url";
import koffi from "koffi";
import { Machine } from "./machine.mjs";

const FLASH_BYTES = 2 << 20;
const here = path.dirname(fileURLToPath(import.meta.url));
const library = koffi.load(path.join(here, "libpico.so"));
const types = {
  powerUp: koffi.proto("bool pico_power_up(const char *wire, const char *rom)"),
  run: koffi.proto("double pico_run(double until_ns)"),
  receive: koffi.proto("void pico_receive(int byte)"),
  press: koffi.proto("void pico_press(bool is_down)"),
  reset: koffi.proto("void pico_reset(bool is_power)"),
};
koffi.struct("machine", {
  power_up: koffi.pointer(types.powerUp),
  run: koffi.pointer(types.run),
  receive: koffi.pointer(types.receive),
  press: koffi.pointer(types.press),
  reset: koffi.pointer(types.reset),
});
const lib = {
  start: library.func("bool pico_start(double, int, bool)"),
  put: library.func("bool pico_put(double, int)"),
  get: library.func("int pico_get(double, bool)"),
  stop: library.func("void pico_stop(double)"),
  holdsSda: library.func("bool pico_holds_sda(double)"),
  clock: library.func("void pico_clock(double)"),
  byte: library.func("void pico_byte(double, int)"),
  writesFlash: library.func("void pico_writes_flash(double)"),
  wasReset: library.func("void pico_was_reset(double)"),
  mark: library.func("void pico_mark(double, double, bool)"),
  overran: library.func("void pico_overran()"),
  stack: library.func("void pico_stack(double)"),
  slept: library.func("void pico_slept(double)"),
  complain: library.func("void pico_complain(const char *)"),
  advance: library.func("bool pico_advance(double)"),
  next: library.func("double pico_next()"),
};
const flashOf = library.func("void *pico_flash()");
const main = library.func("int pico_main(const char **, const machine *)");

/** @type {Machine} */
let machine;

/** The flash chip's id: another one for each seed. */
function idOf(words) {
  const at = words.indexOf("--seed");
  const seed = BigInt(at < 0 ? 1 : words[at + 1]);
  const id = new Uint8Array(8);
  new DataView(id.buffer).setBigUint64(0, 0xe661640843000000n + BigInt.asUintN(24, seed));
  return id;
}

const words = process.argv.slice(2);
const hooks = {
  power_up: koffi.register((wire, rom) => {
    const flash = new Uint8Array(koffi.view(flashOf(), FLASH_BYTES));
    const bytes = fs.readFileSync(rom ?? path.join(here, "rom.bin"));
    if (!["usb", "uart"].includes(wire)) {
      return false;
    }
    machine = new Machine(lib, flash, bytes, idOf(words), wire);
    return true;
  }, koffi.pointer(types.powerUp)),
  run: koffi.register((untilNs) => machine.run(untilNs), koffi.pointer(types.run)),
  receive: koffi.register((byte) => machine.take(byte), koffi.pointer(types.receive)),
  press: koffi.register((isDown) => machine.press(isDown), koffi.pointer(types.press)),
  reset: koffi.register((isPower) => machine.reset(isPower), koffi.pointer(types.reset)),
};
process.exit(main([...words, null], hooks));
