/** Synthesised sound of a diesel engine and its hydraulic pump. */

import { clamp } from "../clamp";

/** What the sound follows. */
export interface EngineInput {
  /** Engine load, 0 to 1. */
  load: number;
  /** Sum of the joint speeds relative to their maxima, 0 to about 2: flow of the pump. */
  hydraulic_flow: number;
  /** Travel speed of the tracks [m/s]. */
  track_speed: number;
  /** Distance from the camera [m]. */
  distance: number;
}

const IDLE_RPM = 900;
const WORKING_RPM = 1800;
/** Drop of the engine speed under full load [1/min]; the governor allows it. */
const DROOP_RPM = 140;
/** Pistons of the axial piston pump: its tone is that many times the shaft speed. */
const PUMP_PISTONS = 9;
/** Distance at which the volume is one half [m]. */
const HALF_VOLUME_DISTANCE = 18;
/** Time in which the tones follow a change [s]. */
const FOLLOW_TIME = 0.12;
/** Time in which the engine speed rises from idle, or falls back [s]. */
const THROTTLE_TIME = 0.6;
const MASTER_VOLUME = 0.35;

/** Amplitudes of the harmonics of one engine cycle (two revolutions); the sixth is the ignition of six cylinders. */
const CYCLE_HARMONICS = [0, 0.06, 0.1, 0.42, 0.1, 0.08, 1, 0.07, 0.06, 0.34, 0.05, 0.05, 0.5, 0, 0, 0.16, 0, 0, 0.22];

interface Graph {
  context: AudioContext;
  master: GainNode;
  cycle: OscillatorNode;
  body: BiquadFilterNode;
  combustion: GainNode;
  pump: OscillatorNode;
  pumpGain: GainNode;
  tracksGain: GainNode;
}

/** The sound; silent until `start`, which browsers allow only after a gesture of the user. */
export class EngineSound {
  private graph: Graph | null = null;
  private rpm = IDLE_RPM;
  private lastTime = 0;

  get isOn(): boolean {
    return this.graph !== null;
  }

  /** Start the sound; to be called from the handler of a click or key. */
  start(): void {
    if (this.graph !== null) return;
    this.graph = buildGraph(new AudioContext());
    this.rpm = IDLE_RPM;
    this.lastTime = this.graph.context.currentTime;
    void this.graph.context.resume();
  }

  stop(): void {
    const { graph } = this;
    if (graph === null) return;
    this.graph = null;
    graph.master.gain.setTargetAtTime(0, graph.context.currentTime, 0.05);
    setTimeout(() => void graph.context.close(), 300);
  }

  /** Follow the machine; null if there is none or the simulation is paused. To be called about 10 times a second. */
  update(input: EngineInput | null): void {
    if (this.graph === null) return;
    const { context, master, cycle, body, combustion, pump, pumpGain, tracksGain } = this.graph;
    const now = context.currentTime;
    const follow = (parameter: AudioParam, value: number): void => {
      parameter.setTargetAtTime(value, now, FOLLOW_TIME);
    };
    if (input === null) {
      follow(master.gain, 0);
      return;
    }
    const load = clamp(input.load, 0, 1);
    const flow = clamp(input.hydraulic_flow / 2, 0, 1);
    const work = clamp(3 * load + 4 * flow + Math.abs(input.track_speed), 0, 1);
    const goal = IDLE_RPM + (WORKING_RPM - IDLE_RPM) * work - DROOP_RPM * load;
    this.rpm += (goal - this.rpm) * (1 - Math.exp(-(now - this.lastTime) / THROTTLE_TIME));
    this.lastTime = now;

    const shaft = this.rpm / 60;
    follow(cycle.frequency, shaft / 2);
    follow(body.frequency, 260 + 0.25 * this.rpm + 900 * load);
    follow(combustion.gain, 0.12 + 0.35 * load);
    follow(pump.frequency, shaft * PUMP_PISTONS * (1 + 0.02 * load));
    follow(pumpGain.gain, 0.006 + 0.05 * flow + 0.02 * load);
    follow(tracksGain.gain, 0.25 * clamp(Math.abs(input.track_speed), 0, 1));
    const attenuation = HALF_VOLUME_DISTANCE / (HALF_VOLUME_DISTANCE + Math.max(input.distance, 0));
    follow(master.gain, MASTER_VOLUME * (0.55 + 0.45 * load) * attenuation);
  }
}

function buildGraph(context: AudioContext): Graph {
  const master = new GainNode(context, { gain: 0 });
  master.connect(new DynamicsCompressorNode(context)).connect(context.destination);

  // Exhaust: the harmonics of the engine cycle, clipped softly, through the muffler.
  const sine = new Float32Array(CYCLE_HARMONICS);
  const wave = new PeriodicWave(context, { real: new Float32Array(sine.length), imag: sine });
  const cycle = new OscillatorNode(context, { type: "custom", periodicWave: wave, frequency: IDLE_RPM / 120 });
  const body = new BiquadFilterNode(context, { type: "lowpass", frequency: 500, Q: 0.7 });
  cycle.connect(new WaveShaperNode(context, { curve: softClip() })).connect(body);
  body.connect(new GainNode(context, { gain: 0.8 })).connect(master);

  // Combustion and rattle: noise that swells with each ignition.
  const noise = new AudioBufferSourceNode(context, { buffer: noiseBuffer(context), loop: true });
  const rattle = new BiquadFilterNode(context, { type: "bandpass", frequency: 900, Q: 0.6 });
  const ignitions = new GainNode(context, { gain: 0 });
  const combustion = new GainNode(context, { gain: 0.1 });
  cycle.connect(ignitions.gain);
  noise.connect(rattle).connect(ignitions).connect(combustion).connect(master);

  // Pump: a whine that is heard when oil flows.
  const pump = new OscillatorNode(context, { type: "triangle", frequency: (IDLE_RPM / 60) * PUMP_PISTONS });
  const pumpGain = new GainNode(context, { gain: 0 });
  pump.connect(pumpGain).connect(master);

  // Tracks: dull noise of the shoes.
  const shoes = new BiquadFilterNode(context, { type: "bandpass", frequency: 340, Q: 1.2 });
  const tracksGain = new GainNode(context, { gain: 0 });
  noise.connect(shoes).connect(tracksGain).connect(master);

  cycle.start();
  pump.start();
  noise.start();
  return { context, master, cycle, body, combustion, pump, pumpGain, tracksGain };
}

function softClip(): Float32Array<ArrayBuffer> {
  const curve = new Float32Array(257);
  for (let i = 0; i < curve.length; i++) curve[i] = Math.tanh((2.2 * (i - 128)) / 128);
  return curve;
}

/** Return two seconds of white noise. */
function noiseBuffer(context: AudioContext): AudioBuffer {
  const buffer = context.createBuffer(1, 2 * context.sampleRate, context.sampleRate);
  const samples = buffer.getChannelData(0);
  for (let i = 0; i < samples.length; i++) samples[i] = 2 * Math.random() - 1;
  return buffer;
}
