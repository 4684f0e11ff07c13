// SPDX-License-Identifier: MIT
// @ts-check
// An Arduino Nano made of avr8js: its peripherals, what is wired to them, and what the
// ATmega328P does (data sheet DS40002061B, sections beside the code) where avr8js does
// something that this image would stumble over.
import { FLAG_BUTTON, FLAG_DATA_READY, FLAG_END } from "./outside.js";

/** @typedef {typeof import("avr8js")} Avr8js */
/** @typedef {import("./outside.js").Outside} Outside */

const HZ = 16_000_000;
const NS_PER_CYCLE = 62.5;
const FLASH_WORDS = 0x4000;
const SRAM_START = 0x100;
const SRAM_BYTES = 2048;
const REGISTERS = 32;
const EEPROM_BYTES = 1024;

// The outside is asked at least so often: 1 ms.
const CYCLES_UNASKED_MAX = 16_000;

// Data-space addresses, and bits (register summary, 30).
const SMCR = 0x53;
const SMCR_SE = 1 << 0;
const MCUSR = 0x54;
const MCUSR_PORF = 1 << 0;
const TWSR = 0xb9;
const TWSR_PRESCALER = 0x03;
const TWCR = 0xbc;
const TWCR_TWINT = 1 << 7;
const TWCR_TWSTA = 1 << 5;
const TWCR_TWSTO = 1 << 4;
const UCSR0A = 0xc0;
const UCSR0A_RXC = 1 << 7;
const UCSR0A_READ_ONLY = 0xbc; // RXC0, UDRE0, FE0, DOR0, UPE0
const UCSR0B = 0xc1;
const UCSR0B_RXCIE = 1 << 7;
const UCSR0B_RXEN = 1 << 4;

// Pins of ports C and D.
const PIN_SDA = 4;
const PIN_SCL = 5;
const PIN_RXD = 0;
const PIN_DATA_READY = 2;
const PIN_BUTTON = 3;
const ADC_FLOATING = 7;

const OPCODE_SEI = 0x9478;
const OPCODE_RETI = 0x9518;
const OPCODE_SLEEP = 0x9588;

// avr8js counts 2 cycles for the entry of a handler, the data sheet 4 (7.7.1), and 4
// more where it ends a sleep.
const ENTRY_CYCLES_MORE = 2;
const WAKE_UP_CYCLES = 4;

/** What outlives a reset. */
export class Kept {
  program = new Uint16Array(FLASH_WORDS).fill(0xffff);
  registers = new Uint8Array(REGISTERS);
  sram = new Uint8Array(SRAM_BYTES);
  causes = MCUSR_PORF; // 11.9.1
  cycles = 0;
  noise = 1;

  /** @param {Avr8js} avr8js */
  constructor(avr8js) {
    this.eeprom = new avr8js.EEPROMMemoryBackend(EEPROM_BYTES);
  }

  /** A bit of noise (xorshift32, Marsaglia 2003). */
  bit() {
    this.noise ^= this.noise << 13;
    this.noise ^= this.noise >>> 17;
    this.noise ^= this.noise << 5;
    return this.noise & 1;
  }
}

export class Board {
  #isReset = false;
  #isOver = false;
  #due = 0; // cycle at which the outside is asked
  /** @type {number[]} */
  #line = []; // bytes on their way to the UART

  /**
   * @param {Avr8js} avr8js
   * @param {Outside} outside
   * @param {Kept} kept
   */
  constructor(avr8js, outside, kept) {
    this.avr8js = avr8js;
    this.outside = outside;
    this.kept = kept;
    const cpu = new avr8js.CPU(kept.program, SRAM_BYTES);
    this.cpu = cpu;
    cpu.cycles = kept.cycles;
    cpu.data.set(kept.registers);
    cpu.data.set(kept.sram, SRAM_START);
    cpu.data[MCUSR] = kept.causes;
    // Called by avr8js's watchdog. It leaves most registers as they are, SREG and those
    // of peripherals included; so each reset makes a new board instead.
    cpu.reset = () => {
      this.#isReset = true;
    };
    new avr8js.AVRTimer(cpu, avr8js.timer0Config);
    new avr8js.AVRTimer(cpu, avr8js.timer1Config);
    new avr8js.AVREEPROM(cpu, kept.eeprom);
    new avr8js.AVRWatchdog(
      cpu,
      avr8js.watchdogConfig,
      new avr8js.AVRClock(cpu, HZ),
    );
    new avr8js.AVRIOPort(cpu, avr8js.portBConfig);
    const portC = new avr8js.AVRIOPort(cpu, avr8js.portCConfig);
    portC.setPin(PIN_SDA, true); // the pull-ups of the bus
    portC.setPin(PIN_SCL, true);
    this.portD = new avr8js.AVRIOPort(cpu, avr8js.portDConfig);
    this.portD.setPin(PIN_RXD, true);
    this.usart = this.#makeUart();
    this.#makeBus();
    this.#makeConverter();
  }

  get now_ns() {
    return this.cpu.cycles * NS_PER_CYCLE;
  }

  /** Runs until a reset or the end; whether it was a reset. */
  run() {
    const { cpu, avr8js } = this;
    while (!this.#isOver && !this.#isReset) {
      const opcode = cpu.progMem[cpu.pc];
      avr8js.avrInstruction(cpu);
      if (cpu.cycles >= this.#due) {
        this.#ask("T", 0);
      }
      if (opcode === OPCODE_SLEEP && (cpu.data[SMCR] & SMCR_SE) !== 0) {
        this.#sleep();
      } else if (opcode !== OPCODE_SEI && opcode !== OPCODE_RETI) {
        // The instruction after those two runs before any handler (7.7).
        this.#tick();
      }
    }
    const { kept } = this;
    kept.cycles = cpu.cycles;
    kept.causes = cpu.data[MCUSR];
    kept.registers.set(cpu.data.subarray(0, REGISTERS));
    kept.sram.set(cpu.data.subarray(SRAM_START));
    return this.#isReset;
  }

  // Idle mode (10.3), in which clocks continue; for avr8js SLEEP is a NOP.
  #sleep() {
    const { cpu } = this;
    const at = cpu.pc;
    while (cpu.pc === at && !this.#isOver && !this.#isReset) {
      cpu.cycles++;
      if (cpu.cycles >= this.#due) {
        this.#ask("T", 0);
      }
      this.#tick();
    }
    cpu.cycles += WAKE_UP_CYCLES;
  }

  #tick() {
    const { cpu } = this;
    const before = cpu.pc;
    cpu.tick();
    if (cpu.pc !== before) {
      cpu.cycles += ENTRY_CYCLES_MORE;
    }
  }

  /**
   * Asks the outside and follows what it answers.
   * @param {string} kind
   * @param {number} argument
   */
  #ask(kind, argument) {
    const { cpu, portD } = this;
    const reply = this.outside.ask(kind, argument, this.now_ns);
    portD.setPin(PIN_DATA_READY, (reply.flags & FLAG_DATA_READY) !== 0);
    portD.setPin(PIN_BUTTON, (reply.flags & FLAG_BUTTON) === 0);
    this.#isOver ||= (reply.flags & FLAG_END) !== 0;
    this.#due = Math.min(
      Math.ceil(reply.next_ns / NS_PER_CYCLE),
      cpu.cycles + CYCLES_UNASKED_MAX,
    );
    if (reply.bytes.length > 0) {
      this.#line.push(...reply.bytes);
      this.#receive();
    }
    return reply.value;
  }

  #receive() {
    while (this.#line.length > 0 && !this.usart.rxBusy) {
      this.usart.writeByte(this.#line.shift() ?? 0);
    }
  }

  // The UART (20), as avr8js has it but for two registers.
  #makeUart() {
    const { cpu, avr8js } = this;
    const usart = new avr8js.AVRUSART(cpu, avr8js.usart0Config, HZ);
    usart.onByteTransmit = (byte) => this.outside.tell("U", byte, this.now_ns);
    usart.onRxComplete = () => this.#receive();
    const received = {
      address: avr8js.usart0Config.rxCompleteInterrupt,
      flagRegister: UCSR0A,
      flagMask: UCSR0A_RXC,
      enableRegister: UCSR0B,
      enableMask: UCSR0B_RXCIE,
      constant: true,
    };
    // Writing leaves read-only flags as they are (20.11.2); avr8js clears them.
    const writeA = cpu.writeHooks[UCSR0A];
    cpu.writeHooks[UCSR0A] = (value, before, ...more) => {
      writeA(value, before, ...more);
      cpu.data[UCSR0A] |= before & UCSR0A_READ_ONLY;
      return true;
    };
    // A received byte waits for UDR0 to be read (20.7.3); avr8js drops it at any write of
    // UCSR0B.
    const writeB = cpu.writeHooks[UCSR0B];
    cpu.writeHooks[UCSR0B] = (value, ...more) => {
      const waits = (cpu.data[UCSR0A] & UCSR0A_RXC) !== 0;
      writeB(value, ...more);
      if (waits && (value & UCSR0B_RXEN) !== 0) {
        cpu.setInterruptFlag(received);
      }
      return true;
    };
    return usart;
  }

  // The two-wire interface (22): what is on the wire, in the time that it takes.
  #makeBus() {
    const { cpu, avr8js } = this;
    const twi = new avr8js.AVRTWI(cpu, avr8js.twiConfig, HZ);
    /** @type {(bits: number, then: () => void) => void} */
    const after = (bits, then) => {
      cpu.addClockEvent(then, (bits * HZ) / twi.sclFrequency);
    };
    // The status is read-only (22.9.3); avr8js has it overwritten.
    cpu.writeHooks[TWSR] = (value, before) => {
      cpu.data[TWSR] =
        (before & ~TWSR_PRESCALER) | (value & TWSR_PRESCALER);
      return true;
    };
    // A START that is asked for while the STOP is on its way follows it (22.9.2, TWSTA);
    // avr8js forgets it.
    const write = cpu.writeHooks[TWCR];
    let isStopping = false;
    let follows = 0;
    cpu.writeHooks[TWCR] = (value, ...more) => {
      if (!isStopping) {
        return write(value, ...more);
      }
      follows = (value & TWCR_TWSTA) !== 0 ? value & ~TWCR_TWSTO : 0;
      cpu.data[TWCR] = value & ~TWCR_TWINT;
      return true;
    };
    twi.eventHandler = {
      start: () => after(1, () => twi.completeStart()),
      stop: () => {
        isStopping = true;
        after(1, () => {
          this.#ask("P", 0);
          twi.completeStop();
          isStopping = false;
          if (follows !== 0) {
            write(follows, cpu.data[TWCR], TWCR, 0xff);
            follows = 0;
          }
        });
      },
      connectToSlave: (address, isWrite) =>
        after(9, () => {
          const byte = (address << 1) | (isWrite ? 0 : 1);
          twi.completeConnect(this.#ask("A", byte) !== 0);
        }),
      writeByte: (byte) =>
        after(9, () => twi.completeWrite(this.#ask("W", byte) !== 0)),
      readByte: (ack) =>
        after(9, () => twi.completeRead(this.#ask("R", ack ? 1 : 0))),
    };
  }

  // The converter (24), with noise on the pin that nothing is connected to.
  #makeConverter() {
    const { cpu, avr8js, kept } = this;
    const adc = new avr8js.AVRADC(cpu, avr8js.adcConfig);
    const read = adc.onADCRead;
    adc.onADCRead = (input) => {
      adc.channelValues[ADC_FLOATING] = 2.5 + kept.bit() / 100; // about 2 counts
      read(input);
    };
  }
}
