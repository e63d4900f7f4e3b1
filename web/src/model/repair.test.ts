import { describe, expect, it } from "vitest";
import crazyflie from "../../../config/log-mappings/crazyflie-usdlog.toml?raw";
import mavlink from "../../../config/log-mappings/mavlink-tlog.toml?raw";
import px4 from "../../../config/log-mappings/px4-ulog.toml?raw";
import ros2 from "../../../config/log-mappings/ros2.toml?raw";
import { AS_IS, UP_LEFT, adviceFor, axesIn, axesText, isChosen, isOfMotors, mappingOf, motorsWithoutCommand, orderIn, orderOf, sourceOf, suggestionOf } from "./repair";

describe("a log that is read again otherwise", () => {
  it("reads axes and orders from the findings", () => {
    const axes = axesIn("the body rates fit the attitude as (y, x, −z) (93 % of the motion, as they are 2 %)");
    expect(axes).toEqual([[1, 1], [0, 1], [2, -1]]);
    expect(axesText(axes ?? AS_IS)).toBe("(y, x, −z)");
    expect([axesIn("as (x, x, z)"), axesIn("gravity lies on the wrong axis: (0, 0, −9.81)")]).toEqual([undefined, undefined]);
    expect(orderIn("the vehicle turns as if duty_1 drives rotor 3, duty_3 drives rotor 1 (correlation² 0.8)")).toEqual([3, 2, 1]);
    expect(isChosen(suggestionOf([{ kind: "stuck", detail: "" }]))).toBe(false);
  });
  it("keeps motors that are not named, and reads typed orders", () => {
    expect(orderIn("duty_1 drives rotor 2, duty_2 drives rotor 1", 4)).toEqual([2, 1, 3, 4]);
    expect(["3, 2 1", "", "1 1", "0 1", "a"].map(orderOf)).toEqual([[3, 2, 1], undefined, undefined, undefined, undefined]);
  });
  it("reads the order of the motors from the refusal of a comparison, which a page needs no command for", () => {
    const refusal = "motors: the log is at fault, not the physics: swapped motors: the vehicle turns as if duty_1 drives rotor 2, duty_2 drives rotor 1 (correlation² 0.85, in the file's order 0.28); `@order:2-1-3-4` behind the log's name reads it in that order, `@order:1-2-3-4` as it is; fix it (a mapping for 'rotortwin log import' converts axes and units) and try again";
    expect([isOfMotors(refusal), isOfMotors("swapped axes: as (y, x, z)")]).toEqual([true, false]);
    expect(orderIn(refusal, 4)).toEqual([2, 1, 3, 4]);
    expect(motorsWithoutCommand(refusal)).toBe("motors: the log is at fault, not the physics: swapped motors: the vehicle turns as if duty_1 drives rotor 2, duty_2 drives rotor 1 (correlation² 0.85, in the file's order 0.28). Step 2 reads it again in the order that fits.");
    expect(motorsWithoutCommand("rotor count; fix it")).toBe("rotor count; fix it");
  });
  it("says what to do where no choice helps", () => {
    expect([adviceFor("no_flight", "px4-ulog"), adviceFor("time_scale", "px4-ulog")].every((one) => (one ?? "").length > 40)).toBe(true);
    expect([adviceFor("time_scale", "canonical"), adviceFor("swapped_axes", "canonical")]).toEqual([undefined, undefined]);
  });
  it("exchanges columns of a canonical file", () => {
    const choice = suggestionOf([{ kind: "swapped_axes", detail: "the body rates fit the attitude as (y, x, z) (93 % of the motion, as they are 2 %)" }]);
    expect(mappingOf(sourceOf(undefined, "a.parquet"), choice, "", 4)).toBe(
      ['source = "canonical"', "", ...["roll", "pitch", "yaw"].flatMap((name, k) => ["[[column]]", `to = "${name}_rate_rad_s"`, `from = "file:${["pitch", "roll", "yaw"][k]}_rate_rad_s"`, 'unit = "rad/s"', ""])].join("\n"),
    );
    expect(mappingOf("canonical", { axes: {}, units: { accel: "g" }, order: [2, 1, 3] }, "", 3)).toContain('from = "file:duty_2,duty_1,duty_3"');
    expect(mappingOf("canonical", { axes: { rates: AS_IS }, units: {} }, "", 4)).toBeUndefined();
  });
  it("knows a source by what the import found, then by the name", () => {
    expect([sourceOf("run_mcap", "a.mcap"), sourceOf(undefined, "a.mcap"), sourceOf(undefined, "a.tlog"), sourceOf(undefined, "a.db3"), sourceOf(undefined, "a.TSV"), sourceOf(undefined, "log00")])
      .toEqual(["run-mcap", "ros2", "mavlink-tlog", "ros2", "canonical", "crazyflie-usdlog"]);
    const turned = { axes: { rates: UP_LEFT }, units: {} };
    expect(mappingOf("mavlink-tlog", turned, mavlink, 4)).toContain('source = "mavlink-tlog"\n\n[[column]]\nto = "roll_rate_rad_s"\nfrom = "HIGHRES_IMU:xgyro"');
    // Its axes are forward-left-up already.
    expect(mappingOf("ros2", turned, ros2, 4)).toContain('to = "pitch_rate_rad_s"\nfrom = "sensor_msgs/Imu:angular_velocity.y"\nunit = "rad/s"\n\n');
  });
  it("changes the built-in rows of an autopilot, after their own frame", () => {
    const swapped = mappingOf("px4-ulog", { axes: { rates: [[1, 1], [0, 1], [2, 1]] }, units: {} }, px4, 4) ?? "";
    expect(swapped).toContain('to = "roll_rate_rad_s"\nfrom = "vehicle_angular_velocity:xyz[1]"\nunit = "rad/s"');
    expect(swapped).toContain('to = "roll_rate_rad_s"\nfrom = "vehicle_attitude:pitchspeed"');
    // Its axes are forward-left-up already: converting twice restores them.
    const twice = mappingOf("crazyflie-usdlog", { axes: { accel: UP_LEFT }, units: {} }, crazyflie, 4) ?? "";
    expect(twice).toContain('to = "accel_y_m_s2"\nfrom = "fixedFrequency:acc.y"\nunit = "g"');
    expect(twice).not.toContain("factor = -1.0\n\n[[column]]\nto = \"accel_y");
    const order = mappingOf("px4-ulog", { axes: {}, units: {}, order: [1, 3, 2] }, px4, 3) ?? "";
    expect(order.match(/order = \[1,3,2\]/g)).toHaveLength(4);
  });
});
