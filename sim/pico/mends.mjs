// SPDX-License-Identifier: MIT
// What rp2040js 1.4.1 lacks, mended from outside: the UART's transmitter and its
// interrupts, the I2C's interrupts, and the flash chip's own id.

const RX_FIFO = 32;
const TX_FIFO = 32;
const TX_FULL = 1 << 5;
const TX_EMPTY = 1 << 7;
const RX_FULL = 1 << 6;
const RX_EMPTY = 1 << 4;
const BUSY = 1 << 3;
const TX_INTERRUPT = 1 << 5;
const RX_INTERRUPT = 1 << 4;
// UARTIFLS after reset: half of the FIFO; the SDK sets an eighth for transmitting.
const TX_LEVEL = 4;

/**
 * A transmitter with a FIFO, a byte in the time of ten bits, and an interrupt that ends.
 * @returns {(byte: number) => boolean} takes a byte for the receiver; false: it overran
 */
export function mendUart(mcu, clock, uart, sink) {
  const waiting = [];
  let isBusy = false;
  const tell = () => mcu.setInterrupt(uart.irq, Boolean(uart.interruptStatus & uart.interruptMask));
  uart.checkInterrupts = tell;
  const go = () => {
    if (!isBusy && waiting.length > 0) {
      isBusy = true;
      sent.schedule(10e9 / uart.baudRate);
    }
  };
  const sent = clock.createAlarm(() => {
    const byte = waiting.shift();
    isBusy = false;
    sink(byte);
    if (waiting.length === TX_LEVEL) {
      uart.interruptStatus |= TX_INTERRUPT;
      tell();
    }
    go();
  });
  uart.onByte = (byte) => {
    if (waiting.length <= TX_FIFO) {
      waiting.push(byte);
      if (waiting.length > TX_LEVEL) {
        uart.interruptStatus &= ~TX_INTERRUPT;
        tell();
      }
      go();
    }
  };
  Object.defineProperty(uart, "flags", {
    get: () =>
      (uart.rxFIFO.full ? RX_FULL : 0) |
      (uart.rxFIFO.empty ? RX_EMPTY : 0) |
      (waiting.length > TX_FIFO ? TX_FULL : 0) |
      (waiting.length <= 1 ? TX_EMPTY : 0) |
      (isBusy ? BUSY : 0),
  });
  return (byte) => {
    if (uart.rxFIFO.itemCount >= RX_FIFO) {
      return false;
    }
    uart.rxFIFO.push(byte);
    uart.interruptStatus |= RX_INTERRUPT;
    tell();
    return true;
  };
}

const IC_DATA_CMD = 0x10;
const IC_INTR_MASK = 0x30;
const IC_INTR_MASK_BITS = 0x1fff;
const IC_CLR_INTR = 0x40;
const RX_FULL_BIT = 1 << 2;
const TX_EMPTY_BIT = 1 << 4;

/** Its interrupt mask can be written, and RX_FULL and TX_EMPTY follow the FIFOs. */
export function mendI2c(i2c) {
  const write = i2c.writeUint32.bind(i2c);
  const read = i2c.readUint32.bind(i2c);
  const follow = () => {
    const isFull = i2c.rxFIFO.itemCount > i2c.rxThreshold;
    const isEmpty = i2c.txFIFO.itemCount <= i2c.txThreshold;
    const levels = (isFull ? RX_FULL_BIT : 0) | (isEmpty ? TX_EMPTY_BIT : 0);
    const raw = (i2c.intRaw & ~(RX_FULL_BIT | TX_EMPTY_BIT)) | levels;
    if (raw !== i2c.intRaw) {
      i2c.intRaw = raw;
    }
    i2c.checkInterrupts();
  };
  i2c.writeUint32 = (offset, value) => {
    if (offset === IC_INTR_MASK) {
      i2c.intEnable = value & IC_INTR_MASK_BITS;
    } else {
      write(offset, value);
    }
    follow();
  };
  i2c.readUint32 = (offset) => {
    const value = read(offset);
    if (offset === IC_DATA_CMD || offset === IC_CLR_INTR) {
      follow();
    }
    return value;
  };
  return follow;
}

const SSI_DR0 = 0x60;
const READ_ID = 0x4b; // of the Winbond flash: four bytes of nothing, then eight of its id
const ID_FROM = 5;

/** The flash chip tells its own id. */
export function mendFlash(ssi, id) {
  const write = ssi.writeUint32.bind(ssi);
  const read = ssi.readUint32.bind(ssi);
  const sent = [];
  const answers = [];
  ssi.writeUint32 = (offset, value) => {
    if (offset !== SSI_DR0) {
      sent.length = 0;
      write(offset, value);
      return;
    }
    if (sent.length === 0 && value !== READ_ID) {
      answers.length = 0;
      write(offset, value);
      return;
    }
    const at = sent.push(value) - 1 - ID_FROM;
    answers.push(at >= 0 && at < id.length ? id[at] : 0);
    if (at === id.length - 1) {
      sent.length = 0;
    }
  };
  ssi.readUint32 = (offset) => {
    if (offset === SSI_DR0 && answers.length > 0) {
      return answers.shift();
    }
    return read(offset);
  };
}
