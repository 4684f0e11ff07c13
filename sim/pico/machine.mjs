// SPDX-License-Identifier: MIT
// A Raspberry Pi Pico: rp2040js with the board's wiring. What happens on its pins and
// wires it tells the library of pico.c, whose time is this one's.

import { ConsoleLogger, LogLevel, Simulator, USBCDC } from "rp2040js";
import { mendFlash, mendI2c, mendUart } from "./mends.mjs";

const CYCLE_NS = 8; // 125 MHz
const FLASH_AT = 0x10000000;
const VECTORS = 0x100; // of an image, behind the second stage of its boot loader
const BIT_NS = 1e9 / 400e3;
const PIN = { sda: 4, scl: 5, ready: 6, button: 15, busy: 22, vsys: 29 };
// Of the memory map, in 16 KB: the ROM's port (rom/rom.c), and what rp2040js leaves out.
const PORT = 0x4006c;
const PORT_OFFSET = 0xf0;
const VREG_AND_CHIP_RESET = 0x40064;
const CHIP_RESET = 0x08;
const HAD_POR = 1 << 8;
const HAD_RUN = 1 << 16;
const SSI = 0x18000;
// W25Q16JV, typical: a page is programmed in 0.4 ms, a sector erased in 45.
const ACTION_NS = [0, 0.4e6, 45e6];
const LOADER = 3;
const HARD_FAULT = 3;
const VSYS_COUNTS = Math.round(((5000 / 3) * 4096) / 3300);

export class Machine {
  /**
   * @param {object} lib functions of pico.c
   * @param {Uint8Array} flash
   * @param {Uint8Array} rom
   * @param {Uint8Array} id of the flash chip
   */
  constructor(lib, flash, rom, id, wire) {
    this.lib = lib;
    this.flash = flash;
    this.rom = rom;
    this.id = id;
    this.wire = wire;
    this.isDown = false;
    this.begunNs = 0; // of this start, since power came
    this.isHalted = false;
    this.top = new DataView(flash.buffer, flash.byteOffset).getUint32(VECTORS, true);
    this.deepest = this.toldDeepest = this.top; // that the stack has been
    this.start({ chip: HAD_POR, reason: 0, scratch: [] });
  }

  now() {
    return this.begunNs + this.clock.nanosCounter;
  }

  /** A new chip over the same flash; the clock of the world goes on. */
  start({ chip, reason, scratch }) {
    const sim = new Simulator();
    const mcu = sim.rp2040;
    mcu.logger = new ConsoleLogger(LogLevel.Error);
    this.clock = sim.clock;
    this.mcu = mcu;
    this.wants = null;
    const words = this.rom.buffer.slice(this.rom.byteOffset, this.rom.byteOffset + this.rom.length);
    mcu.loadBootrom(new Uint32Array(words));
    const { buffer, byteOffset, length } = this.flash;
    mcu.flash = this.flash;
    mcu.flash16 = new Uint16Array(buffer, byteOffset, length / 2);
    mcu.flashView = new DataView(buffer, byteOffset, length);
    const watchdog = mcu.peripherals[0x40058];
    watchdog.reason = reason;
    watchdog.scratchData.set(scratch);
    watchdog.onWatchdogTrigger = () => {
      watchdog.alarm.enable = false; // else it comes again at once, for ever
      this.wants = { chip: 0, reason: watchdog.reason, scratch: [...watchdog.scratchData] };
    };
    const told = { readUint32: (offset) => (offset === CHIP_RESET ? chip : 0) };
    Object.assign(mcu.peripherals[VREG_AND_CHIP_RESET], told, { writeUint32: () => {} });
    // Without a debugger a breakpoint is a hard fault, as an undefined instruction is.
    mcu.onBreak = () => {
      mcu.core.PC -= mcu.core.breakRewind;
      mcu.core.exceptionEntry(HARD_FAULT);
    };
    this.addPort(mcu);
    mendFlash(mcu.peripherals[SSI], this.id);
    this.addSensor(mcu);
    this.addWire(mcu);
    mcu.gpio[PIN.button].setInputValue(!this.isDown);
    mcu.gpio[PIN.busy].addListener((state) => {
      const isHigh = state === 1;
      this.lib.mark(this.now(), this.now() / CYCLE_NS, isHigh);
    });
    mcu.adc.channelValues[3] = VSYS_COUNTS;
    mcu.core.PC = FLASH_AT;
  }

  addPort(mcu) {
    let untilNs = 0;
    const port = mcu.peripherals[PORT];
    port.readUint32 = (offset) => (offset === PORT_OFFSET && this.now() < untilNs ? 1 : 0);
    port.writeUint32 = (offset, value) => {
      if (value === LOADER) {
        this.isHalted = true;
        this.lib.complain("the board waits in its boot loader");
        return;
      }
      untilNs = this.now() + ACTION_NS[value];
      this.lib.writesFlash(this.now());
    };
  }

  addSensor(mcu) {
    const { lib } = this;
    const i2c = mcu.i2c[0];
    const follow = mendI2c(i2c);
    let pending = () => {};
    const alarm = this.clock.createAlarm(() => {
      pending();
      follow();
    });
    const later = (bits, work) => {
      pending = work;
      alarm.schedule(bits * BIT_NS);
    };
    // No START can be made while the chip holds SDA.
    const start = () => (lib.holdsSda(this.now()) ? later(1, start) : i2c.completeStart());
    i2c.onStart = () => later(0.5, start);
    i2c.onConnect = (address, isRead) =>
      later(9, () => i2c.completeConnect(lib.start(this.now(), address & 0x7f, isRead === 1)));
    i2c.onWriteByte = (byte) => later(9, () => i2c.completeWrite(lib.put(this.now(), byte)));
    i2c.onReadByte = (isAcked) => {
      const byte = lib.get(this.now(), isAcked); // a chip has it when its first bit is due
      later(9, () => {
        i2c.completeRead(byte);
        this.advance(); // data-ready may go with a byte
      });
    };
    i2c.onStop = () =>
      later(0.5, () => {
        lib.stop(this.now());
        i2c.completeStop();
      });
    // The lines worked by hand: an output can only be low.
    const [sda, scl] = [mcu.gpio[PIN.sda], mcu.gpio[PIN.scl]];
    const isPulled = (pin) => pin.value === 0;
    let wasPulled = false;
    const look = () => {
      if (wasPulled && !isPulled(scl)) {
        lib.clock(this.now());
      }
      wasPulled = isPulled(scl);
    };
    scl.addListener(look);
    Object.defineProperty(scl, "inputValue", { get: () => !isPulled(scl) });
    Object.defineProperty(sda, "inputValue", {
      get: () => !isPulled(sda) && !lib.holdsSda(this.now()),
    });
    this.isReady = false;
  }

  addWire(mcu) {
    const { lib } = this;
    if (this.wire === "uart") {
      const feed = mendUart(mcu, this.clock, mcu.uart[0], (byte) => lib.byte(this.now(), byte));
      this.take = (byte) => {
        if (!feed(byte)) {
          lib.overran();
        }
      };
      return;
    }
    mendUart(mcu, this.clock, mcu.uart[0], () => {});
    const cdc = new USBCDC(mcu.usbCtrl);
    cdc.onSerialData = (bytes) => {
      for (const byte of bytes) {
        lib.byte(this.now(), byte);
      }
    };
    this.take = (byte) => cdc.sendSerialByte(byte);
  }

  /** The lines of the sensor, and bytes that have come, as they are now. */
  advance() {
    const isReady = this.lib.advance(this.now());
    if (isReady !== this.isReady) {
      this.isReady = isReady;
      this.mcu.gpio[PIN.ready].setInputValue(isReady);
    }
    return this.lib.next();
  }

  run(untilNs) {
    let next = this.advance();
    while (this.now() < untilNs) {
      const end = Math.min(untilNs, next);
      this.work(end - this.begunNs);
      if (this.wants !== null) {
        this.restart(this.wants);
      }
      if (this.now() >= next || this.now() >= untilNs) {
        next = this.advance();
      }
    }
    if (this.deepest < this.toldDeepest) {
      this.toldDeepest = this.deepest;
      this.lib.stack(this.top - this.deepest);
    }
    return this.now();
  }

  /** Runs the processor to a time of its clock. */
  work(endNs) {
    const { clock } = this;
    const { core } = this.mcu;
    while (clock.nanosCounter < endNs && this.wants === null) {
      if (this.isHalted) {
        clock.nanosCounter = endNs;
      } else if (core.waiting && !(core.interruptsUpdated && core.checkForInterrupts())) {
        const alarmNs = clock.nextAlarm === null ? Infinity : clock.nanosToNextAlarm;
        const step = Math.max(Math.min(alarmNs, endNs - clock.nanosCounter), CYCLE_NS);
        clock.tick(step);
        this.lib.slept(step);
      } else {
        core.waiting = false;
        clock.tick(core.executeInstruction() * CYCLE_NS);
        if (core.SPmain < this.deepest) {
          this.deepest = core.SPmain;
        }
      }
    }
  }

  restart(how) {
    this.begunNs = this.now();
    this.isHalted = false;
    this.start(how);
    this.lib.wasReset(this.begunNs);
  }

  press(isDown) {
    this.isDown = isDown;
    this.mcu.gpio[PIN.button].setInputValue(!isDown);
  }

  reset(isPower) {
    this.wants = { chip: isPower ? HAD_POR : HAD_RUN, reason: 0, scratch: [] };
  }
}
