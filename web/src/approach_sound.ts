// What is heard of a no-go region that comes near, as when a car is parked: beeps that follow each other faster and higher, and a tone
// without a break where it pushes. What sounds ends by itself a moment later and is renewed with each pose: where none comes, nothing is heard.

/** Heard from so far before the border. */
export const HEARD_FROM_MM = 10;
/** Of the tone: far off, at the border, and at its highest. */
const FAR_HZ = 440, BORDER_HZ = 660, HIGHEST_HZ = 1320;
/** So deep in a region it is at its highest. */
const DEEPEST_MM = 3;
/** Beeps a second: far off and at the border. */
const FAR_BEEPS = 1.5, BORDER_BEEPS = 8;
const BEEP_S = 0.06;
/** A tone without a break that is not renewed lasts no longer. */
const LASTS_S = 0.3;
/** From silence to the tone and back, so that nothing clicks. */
const FADE_S = 0.006;
const LOUDNESS = 0.15;

/** Of `beeps_per_s` 0 is a tone without a break. */
export interface Tone { frequency_Hz: number; beeps_per_s: number }

/** @param border_mm  to where a region begins to push; below 0: so deep in it. @returns null: nothing is heard */
export function toneAt(border_mm: number): Tone | null {
  if (!(border_mm < HEARD_FROM_MM)) return null;
  if (border_mm < 0) return { frequency_Hz: BORDER_HZ * (HIGHEST_HZ / BORDER_HZ) ** Math.min(1, -border_mm / DEEPEST_MM), beeps_per_s: 0 };
  const near = 1 - border_mm / HEARD_FROM_MM;
  return { frequency_Hz: FAR_HZ * (BORDER_HZ / FAR_HZ) ** near, beeps_per_s: FAR_BEEPS * (BORDER_BEEPS / FAR_BEEPS) ** near };
}

export class ApproachSound {
  /** That is heard now; null: nothing. */
  tone: Tone | null = null;
  isOn = false;
  private context: AudioContext | null = null;
  private voice: { oscillator: OscillatorNode; gain: GainNode } | null = null;
  private nextBeep_s = 0;

  /** A browser lets a page sound only after somebody has pressed something on it. */
  get isHeldBack(): boolean {
    return this.isOn && this.context?.state !== "running";
  }
  switch(isOn: boolean): void {
    this.isOn = isOn;
    if (!isOn) this.silence();
  }
  /** Somebody has pressed something. */
  wake(): void {
    if (!this.isOn) return;
    this.context ??= new AudioContext();
    if (this.context.state !== "running") void this.context.resume();
  }

  /** @param border_mm  as toneAt has it; null: nothing is near */
  tell(border_mm: number | null): void {
    const { context } = this;
    const tone = border_mm === null || !this.isOn || this.isHeldBack ? null : toneAt(border_mm);
    if (!tone || !context) return this.silence();
    const now = context.currentTime;
    this.voice ??= this.begin(context);
    const { oscillator, gain: { gain } } = this.voice;
    oscillator.frequency.setTargetAtTime(tone.frequency_Hz, now, FADE_S);
    const sound = (long_s: number) => {
      gain.cancelScheduledValues(now);
      gain.setTargetAtTime(LOUDNESS, now, FADE_S);
      gain.setTargetAtTime(0, now + long_s, FADE_S);
    };
    if (tone.beeps_per_s === 0) sound(LASTS_S);
    else if (this.tone?.beeps_per_s === 0 || now >= this.nextBeep_s) {
      sound(BEEP_S);
      this.nextBeep_s = now + 1 / tone.beeps_per_s;
    }
    // one that comes nearer waits no longer than it would from here
    this.nextBeep_s = Math.min(this.nextBeep_s, now + 1 / (tone.beeps_per_s || BORDER_BEEPS));
    this.tone = tone;
  }

  silence(): void {
    this.tone = null;
    this.nextBeep_s = 0;
    if (!this.voice || !this.context) return;
    const { oscillator, gain: { gain } } = this.voice;
    const now = this.context.currentTime;
    gain.cancelScheduledValues(now);
    gain.setTargetAtTime(0, now, FADE_S);
    oscillator.stop(now + 10 * FADE_S);
    this.voice = null;
  }

  private begin(context: AudioContext): { oscillator: OscillatorNode; gain: GainNode } {
    const oscillator = context.createOscillator(), gain = context.createGain();
    oscillator.type = "triangle";
    gain.gain.value = 0;
    oscillator.connect(gain).connect(context.destination);
    oscillator.start();
    return { oscillator, gain };
  }
}
