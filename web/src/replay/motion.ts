/** State of the 3-D view at a time: pose, thrusts and estimated losses, from telemetry by name. */
import type { Schemas } from "../api/client";
import type { Narrowed } from "../api/narrowed";
import { type Values, angleAt, heldAt, linearAt } from "../plots/series";

/** Channels of a run by name, with their times. */
export interface Track {
  time: readonly number[];
  data: Readonly<Record<string, Values>>;
}

/** The answer of `/geometry`. Without `hover` no duty carries the vehicle. */
export type FullGeometry = Narrowed<Schemas["VehicleGeometry"], { rotors: FullRotor[] }>;
type FullRotor = Narrowed<Schemas["RotorView"], { position_body_m: [number, number, number] }>;

/** What the views need of it. */
export type Rotor = Pick<FullRotor, "number" | "position_body_m" | "spin">;
export type Geometry = Pick<FullGeometry, "name" | "arm_m"> & {
  rotors: readonly Rotor[];
  hover?: Pick<Schemas["Hover"], "rotor_thrust_n"> | null | undefined;
};

export interface Pose {
  /** North, east, down, m. */
  position: readonly [number, number, number];
  /** Roll, pitch, yaw, rad. */
  attitude: readonly [number, number, number];
  /** Thrust of each rotor, N; from the duty where it is not recorded. */
  thrust: readonly number[];
  /** Estimated loss of each rotor, share of its nominal thrust. */
  loss: readonly number[];
  /** Affected rotors, certain or possible. */
  suspect: readonly boolean[];
}

/** Channels of the view. */
export const MOTION_CHANNELS =
  "true_position_*,true_roll_rad,true_pitch_rad,true_yaw_rad,reference_north_m,reference_east_m,reference_down_m,duty_*,true_thrust_*,verdict_sequential,thrust_loss_share,second_thrust_loss_share,suspect_rotors";

/** The same for a log, which has no truth. */
export const LOG_CHANNELS = "position_*,roll_rad,pitch_rad,yaw_rad,duty_*";

/** Names of positions and angles: the truth if there is one, else the measurement. */
export const prefixOf = (track: Track) => (track.data["true_position_north_m"] ? "true_" : "");

/** Pose at a time; undefined before the first sample. */
export function poseAt(track: Track, geometry: Geometry, at: number): Pose | undefined {
  if (track.time.length === 0) return undefined;
  const { time, data } = track;
  const linear = (name: string) => linearAt(time, data[name] ?? [], at) ?? 0;
  const angle = (name: string) => angleAt(time, data[name] ?? [], at) ?? 0;
  const prefix = prefixOf(track);
  const code = heldAt(time, data["verdict_sequential"] ?? [], at) ?? -2;
  const shares = [heldAt(time, data["thrust_loss_share"] ?? [], at) ?? 0, heldAt(time, data["second_thrust_loss_share"] ?? [], at) ?? 0];
  const named = namedRotors(code);
  const mask = heldAt(time, data["suspect_rotors"] ?? [], at) ?? 0;
  return {
    position: [linear(`${prefix}position_north_m`), linear(`${prefix}position_east_m`), linear(`${prefix}position_down_m`)],
    attitude: [angle(`${prefix}roll_rad`), angle(`${prefix}pitch_rad`), angle(`${prefix}yaw_rad`)],
    thrust: geometry.rotors.map((rotor, k) => {
      const thrust = data[`true_thrust_${rotor.number}_n`];
      if (thrust) return linearAt(time, thrust, at) ?? 0;
      return (linearAt(time, data[`duty_${rotor.number}`] ?? [], at) ?? 0) * 2 * (geometry.hover?.rotor_thrust_n[k] ?? 1);
    }),
    loss: geometry.rotors.map((rotor) => {
      const place = named.indexOf(rotor.number);
      return place < 0 ? 0 : (shares[place] ?? 0);
    }),
    suspect: geometry.rotors.map((rotor) => Math.floor(mask / 2 ** (rotor.number - 1)) % 2 === 1),
  };
}

/** Rotors named by a verdict code, in the order of their losses. */
export function namedRotors(code: number): number[] {
  if (code >= 100) return [Math.floor(code / 100), code % 100];
  return code > 0 ? [code] : [];
}
