/** A vehicle from above: rotors with numbers and spins. Forward is up. Of two on one axis the lower one is drawn further in, and dashed. */
import { For } from "solid-js";
import type { Geometry } from "../replay/motion";
import { levels } from "./coaxial";

export function VehiclePicture(props: { geometry: Pick<Geometry, "name" | "rotors"> }) {
  const reach = () => Math.max(0.01, ...props.geometry.rotors.map((rotor) => Math.hypot(rotor.position_body_m[0], rotor.position_body_m[1])));
  const level = () => levels(props.geometry.rotors);
  const place = (rotor: Geometry["rotors"][number], index: number) => {
    const inwards = 1 - ((level()[index] ?? 0) * (2 * radius() + 2)) / 70;
    return { x: (rotor.position_body_m[1] / reach()) * 70 * inwards, y: (-rotor.position_body_m[0] / reach()) * 70 * inwards };
  };
  const radius = () => Math.min(26, 118 / Math.max(3, props.geometry.rotors.length));
  const words = () => props.geometry.rotors.map((rotor) => `rotor ${rotor.number} ${isLower(rotor) ? "(lower one of its axis) " : ""}turns ${rotor.spin === "cw" ? "clockwise" : "counter-clockwise"}`).join(", ");
  const isLower = (rotor: Geometry["rotors"][number]) => (level()[props.geometry.rotors.indexOf(rotor)] ?? 0) > 0;
  return (
    <svg class="vehicle" viewBox="-105 -105 210 210" role="img" aria-label={`${props.geometry.name} from above, forward is up: ${words()}`}>
      <For each={props.geometry.rotors}>{(rotor, index) => <line x1="0" y1="0" x2={place(rotor, index()).x} y2={place(rotor, index()).y} class="boom" />}</For>
      <path d="M-9 10 L0 -16 L9 10 Z" class="hull" />
      <For each={props.geometry.rotors}>
        {(rotor, index) => (
          <g transform={`translate(${place(rotor, index()).x} ${place(rotor, index()).y})`}>
            <circle r={radius()} class="disc" stroke-dasharray={isLower(rotor) ? "4 3" : undefined} />
            <path d={turn(radius() - 5, rotor.spin === "cw")} class={rotor.spin} />
            <text text-anchor="middle" dy="5">{rotor.number}</text>
          </g>
        )}
      </For>
    </svg>
  );
}

/** Three quarters of a circle with an arrow at its end; y points down, so that a positive angle turns clockwise. */
function turn(radius: number, clockwise: boolean): string {
  const sign = clockwise ? 1 : -1;
  const at = (degrees: number, r: number) => {
    const angle = (sign * degrees * Math.PI) / 180 - Math.PI / 2;
    return `${(r * Math.cos(angle)).toFixed(2)} ${(r * Math.sin(angle)).toFixed(2)}`;
  };
  return `M${at(20, radius)} A${radius} ${radius} 0 1 ${clockwise ? 1 : 0} ${at(290, radius)} M${at(270, radius + 4.5)} L${at(292, radius)} L${at(270, radius - 4.5)}`;
}
