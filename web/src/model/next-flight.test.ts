import { describe, expect, it } from "vitest";
import { candidatesOf, withVehicle } from "./next-flight";
import type { Diagnosis } from "./twin";

describe("what to fly next", () => {
  it("names each effect once, with its rotor", () => {
    const found = {
      effects: [
        { instance: { effect: "rotor-thrust-scale", rotor: 3 }, label: "Rotor thrust", also_compatible: [{ effect: "centre-of-mass", rotor: null, label: "Centre of mass", evidence_gap: 1, reason: "" }] },
        { instance: { effect: "centre-of-mass", rotor: null }, label: "Centre of mass", also_compatible: [] },
      ],
    } as unknown as Diagnosis;
    expect(candidatesOf(found)).toEqual([{ id: "rotor-thrust-scale#3", label: "Rotor thrust, rotor 3" }, { id: "centre-of-mass", label: "Centre of mass" }]);
  });
  it("puts a vehicle of the library into the scenario", () => {
    expect(withVehicle('name = "climb"\nvehicle = "next-flight-vehicle.toml"\nseed = 1\n', "f550")).toBe('name = "climb"\nvehicle = "../vehicles/f550.toml"\nseed = 1\n');
  });
});
