// SPDX-License-Identifier: MIT
// @ts-check
// Notes and a vibration: when a target is reached, and when a probe is lost.

const NOTES = [660, 880]; // Hz
const NOTE_S = 0.14;

/** @type {AudioContext | null} */
let context = null;

/** Allows sounds; to be called while the user presses a button or key. */
export function allowSound() {
  context ??= new AudioContext();
  void context.resume();
}

/**
 * Tells the ear and the hand.
 * @param {readonly number[]} [notes] Hz
 */
export function chime(notes = NOTES) {
  navigator.vibrate?.([80, 60, 80]);
  if (context === null || context.state !== "running") {
    return;
  }
  notes.forEach((frequency, index) => {
    const { currentTime, destination } = /** @type {AudioContext} */ (context);
    const begin = currentTime + index * NOTE_S;
    const tone = /** @type {AudioContext} */ (context).createOscillator();
    const volume = /** @type {AudioContext} */ (context).createGain();
    tone.frequency.value = frequency;
    volume.gain.setValueAtTime(0.2, begin);
    volume.gain.exponentialRampToValueAtTime(0.001, begin + 2 * NOTE_S);
    tone.connect(volume).connect(destination);
    tone.start(begin);
    tone.stop(begin + 2 * NOTE_S);
  });
}
