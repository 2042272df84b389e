// Sound of a burr, synthesised from what the tick reports: rotation rate, load, density and break-through. The notes
// are in docs/decisions/0091-vibration-of-a-burr.md. Imported when it is switched on first.

import { effect } from "@preact/signals-core";
import type { Connection } from "../protocol/connection.js";
import type { DeviceTool } from "../protocol/messages.js";
import { Flag, type DevicePose } from "../protocol/wire.js";
import type { Session } from "../state/session.js";

/** Highest audible partial that is synthesised. */
const MAX_HZ = 12000;
/** Centre of the noise of cutting in soft and in dense bone; measured maxima in cortical bone lie at 4 kHz. */
const SOFT_HZ = 1000,
  DENSE_HZ = 4000;
/** Specific cutting energy of dense bone, the default of a scene, mJ/mm^3. */
const DENSE = 100;
/** Press force at which the noise has half of its greatest loudness, N. */
const HALF_LOUD_N = 1;
const IDLE_GAIN = 0.02,
  EDGES_GAIN = 0.06,
  NOISE_GAIN = 0.16,
  BREAK_GAIN = 0.25;
/** Time constant of changes, and duration of the sound after its latest renewal by a pose. */
const FADE_S = 0.005,
  LASTS_S = 0.3;
const BREAK_S = 0.12,
  BREAK_HZ = 220;

/** Sound of a running burr. */
export interface BurrTone {
  rotation_Hz: number; // the motor
  edges_Hz: number; // passing of the cutting edges
  edgesGain: number;
  noise_Hz: number; // centre of the noise of cutting
  noiseGain: number;
  breaksThrough: boolean;
}

/**
 * Sound of a burr whose motor runs.
 * @param tool  its rotation rate and number of cutting edges
 * @param pose  its load, and the specific cutting energy of the material ahead
 */
export function burrTone(
  { revolutions_per_s, flutes }: Pick<DeviceTool, "revolutions_per_s" | "flutes">,
  { cuttingForce, cuttingEnergy, flags }: Pick<DevicePose, "cuttingForce" | "cuttingEnergy" | "flags">,
): BurrTone {
  const load = cuttingForce / (cuttingForce + HALF_LOUD_N);
  const density = Math.min(1, cuttingEnergy / DENSE);
  return {
    rotation_Hz: Math.min(MAX_HZ, revolutions_per_s),
    edges_Hz: Math.min(MAX_HZ, revolutions_per_s * flutes),
    edgesGain: EDGES_GAIN * load,
    noise_Hz: SOFT_HZ * (DENSE_HZ / SOFT_HZ) ** density,
    noiseGain: NOISE_GAIN * load * Math.sqrt(density),
    breaksThrough: (flags & Flag.breakThrough) !== 0,
  };
}

interface Voice {
  rotation: OscillatorNode;
  edges: OscillatorNode;
  edgesGain: GainNode;
  filter: BiquadFilterNode;
  noiseGain: GainNode;
  master: GainNode;
  sources: AudioScheduledSourceNode[];
}

export class BurrSound {
  isOn = false;
  /** Current sound; null: silence. */
  tone: BurrTone | null = null;
  private context: AudioContext | null = null;
  private voice: Voice | null = null;

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
  ) {
    effect(() => this.follow());
  }

  /** Switches it on or off; to be called in a user gesture, without which browsers block sound. */
  toggle(): void {
    this.isOn = !this.isOn;
    if (this.isOn) {
      this.context ??= new AudioContext();
      if (this.context.state !== "running") void this.context.resume();
    }
    this.follow();
  }

  /** Follows the pose; silent unless a motor runs, while the force is stopped or paused, and without a connection. */
  private follow(): void {
    const pose = this.session.pose.value,
      state = this.session.state.value,
      scene = this.session.scene.value;
    const isConnected = this.connection.link.value === "connected";
    if (!this.isOn || !pose || !scene || !state?.motor_is_on || !isConnected) return this.silence();
    if (state.stop !== null || state.paused || state.playback?.playing === false) return this.silence();
    // the burr under the greatest load
    const [first] = pose.devices
      .filter(({ number }) => scene.tools[number]?.cuts)
      .sort((a, b) => b.cuttingForce - a.cuttingForce);
    if (first) this.sound(burrTone(scene.tools[first.number]!, first));
    else this.silence();
  }

  private sound(tone: BurrTone): void {
    const { context } = this;
    if (!context) return;
    const now = context.currentTime;
    this.voice ??= this.begin(context);
    const { rotation, edges, edgesGain, filter, noiseGain, master } = this.voice;
    rotation.frequency.setTargetAtTime(tone.rotation_Hz, now, FADE_S);
    edges.frequency.setTargetAtTime(tone.edges_Hz, now, FADE_S);
    edgesGain.gain.setTargetAtTime(tone.edgesGain, now, FADE_S);
    filter.frequency.setTargetAtTime(tone.noise_Hz, now, FADE_S);
    noiseGain.gain.setTargetAtTime(tone.noiseGain, now, FADE_S);
    // each pose renews the sound, which otherwise ends
    master.gain.cancelScheduledValues(now);
    master.gain.setTargetAtTime(1, now, FADE_S);
    master.gain.setTargetAtTime(0, now + LASTS_S, FADE_S);
    if (tone.breaksThrough && !this.tone?.breaksThrough) this.breakThrough(context);
    this.tone = tone;
  }

  private silence(): void {
    this.tone = null;
    if (!this.voice || !this.context) return;
    const { master, sources } = this.voice;
    const now = this.context.currentTime;
    master.gain.cancelScheduledValues(now);
    master.gain.setTargetAtTime(0, now, FADE_S);
    for (const source of sources) source.stop(now + 10 * FADE_S);
    this.voice = null;
  }

  private begin(context: AudioContext): Voice {
    const master = context.createGain();
    master.gain.value = 0;
    master.connect(context.destination);
    const voiceOf = (source: AudioNode, loudness: number): GainNode => {
      const gain = context.createGain();
      gain.gain.value = loudness;
      source.connect(gain).connect(master);
      return gain;
    };
    const rotation = context.createOscillator(),
      edges = context.createOscillator(),
      noise = context.createBufferSource(),
      filter = context.createBiquadFilter();
    rotation.type = edges.type = "sawtooth";
    filter.type = "bandpass";
    noise.buffer = context.createBuffer(1, context.sampleRate, context.sampleRate);
    const samples = noise.buffer.getChannelData(0);
    for (let n = 0; n < samples.length; n++) samples[n] = 2 * Math.random() - 1;
    noise.loop = true;
    noise.connect(filter);
    voiceOf(rotation, IDLE_GAIN);
    const sources = [rotation, edges, noise];
    for (const source of sources) source.start();
    return { rotation, edges, edgesGain: voiceOf(edges, 0), filter, noiseGain: voiceOf(filter, 0), master, sources };
  }

  /** A short thud. */
  private breakThrough(context: AudioContext): void {
    const now = context.currentTime;
    const thud = context.createOscillator(),
      gain = context.createGain();
    thud.frequency.value = BREAK_HZ;
    thud.frequency.exponentialRampToValueAtTime(BREAK_HZ / 4, now + BREAK_S);
    gain.gain.setValueAtTime(BREAK_GAIN, now);
    gain.gain.exponentialRampToValueAtTime(1e-3, now + BREAK_S);
    thud.connect(gain).connect(context.destination);
    thud.start();
    thud.stop(now + BREAK_S);
  }
}
