// Auditory proximity warning of no-go regions: beeps whose rate and pitch increase towards the border, and a continuous
// tone during penetration. Every sound has a limited duration and is renewed by each pose, so that it ends if poses do.

/** Distance to the border at which beeps begin. */
export const HEARD_FROM_MM = 10;
/** Frequencies at HEARD_FROM_MM, at the border, and at MAX_DEPTH_MM. */
const FAR_HZ = 440,
  BORDER_HZ = 660,
  MAX_HZ = 1320;
/** Penetration depth at which the maximum frequency is reached. */
const MAX_DEPTH_MM = 3;
/** Beeps per second at HEARD_FROM_MM and at the border. */
const FAR_BEEPS = 1.5,
  BORDER_BEEPS = 8;
const BEEP_S = 0.06;
/** Duration of a continuous tone after its latest renewal. */
const LASTS_S = 0.3;
/** Duration of fading in and out, which avoids clicks. */
const FADE_S = 0.006;
const LOUDNESS = 0.15;

/** Warning tone; continuous if `beeps_per_s` is 0. */
export interface Tone {
  frequency_Hz: number;
  beeps_per_s: number;
}

/**
 * Tone for a distance.
 * @param border_mm  distance to the border at which a region begins to push; negative: penetration
 * @returns null for silence
 */
export function toneAt(border_mm: number): Tone | null {
  if (!(border_mm < HEARD_FROM_MM)) return null;
  if (border_mm < 0)
    return {
      frequency_Hz: BORDER_HZ * (MAX_HZ / BORDER_HZ) ** Math.min(1, -border_mm / MAX_DEPTH_MM),
      beeps_per_s: 0,
    };
  const near = 1 - border_mm / HEARD_FROM_MM;
  return {
    frequency_Hz: FAR_HZ * (BORDER_HZ / FAR_HZ) ** near,
    beeps_per_s: FAR_BEEPS * (BORDER_BEEPS / FAR_BEEPS) ** near,
  };
}

export class ApproachSound {
  /** Current tone; null: silence. */
  tone: Tone | null = null;
  isOn = false;
  private context: AudioContext | null = null;
  private voice: { oscillator: OscillatorNode; gain: GainNode } | null = null;
  private nextBeep_s = 0;

  /** Whether the browser blocks sound until a user gesture on the page. */
  get isBlocked(): boolean {
    return this.isOn && this.context?.state !== "running";
  }
  switch(isOn: boolean): void {
    this.isOn = isOn;
    if (!isOn) this.silence();
  }
  /** Starts audio; to be called in a user gesture. */
  wake(): void {
    if (!this.isOn) return;
    this.context ??= new AudioContext();
    if (this.context.state !== "running") void this.context.resume();
  }

  /**
   * Updates and renews the tone.
   * @param border_mm  as in toneAt; null: silence
   */
  update(border_mm: number | null): void {
    const { context } = this;
    const tone = border_mm === null || !this.isOn || this.isBlocked ? null : toneAt(border_mm);
    if (!tone || !context) return this.silence();
    const now = context.currentTime;
    this.voice ??= this.begin(context);
    const {
      oscillator,
      gain: { gain },
    } = this.voice;
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
    // shortens the pause if the distance has decreased since the previous beep
    this.nextBeep_s = Math.min(this.nextBeep_s, now + 1 / (tone.beeps_per_s || BORDER_BEEPS));
    this.tone = tone;
  }

  silence(): void {
    this.tone = null;
    this.nextBeep_s = 0;
    if (!this.voice || !this.context) return;
    const {
      oscillator,
      gain: { gain },
    } = this.voice;
    const now = this.context.currentTime;
    gain.cancelScheduledValues(now);
    gain.setTargetAtTime(0, now, FADE_S);
    oscillator.stop(now + 10 * FADE_S);
    this.voice = null;
  }

  private begin(context: AudioContext): { oscillator: OscillatorNode; gain: GainNode } {
    const oscillator = context.createOscillator(),
      gain = context.createGain();
    oscillator.type = "triangle";
    gain.gain.value = 0;
    oscillator.connect(gain).connect(context.destination);
    oscillator.start();
    return { oscillator, gain };
  }
}
