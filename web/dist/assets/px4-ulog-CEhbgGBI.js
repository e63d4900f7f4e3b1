var e=`# PX4 ULog → canonical flight log. Of rows with the same \`to\`, the first whose fields are in the log wins.
# Keys of a row: to, from ("topic:field,field"; # instance; [] counts up), unit, frame, factor, valid, unit_as (see ardupilot-dataflash.toml); for duties low, high, order.
# Units and frames: PX4 msg definitions (body FRD, world NED, quaternion w x y z from body to world).

source = "px4-ulog"
# Streams that may give the time base, best first.
base = ["vehicle_angular_velocity", "sensor_combined", "vehicle_attitude"]

[[column]]
to = "rates"
from = "vehicle_angular_velocity:xyz[]"
unit = "rad/s"

[[column]] # before 2019
to = "rates"
from = "sensor_combined:gyro_rad[]"
unit = "rad/s"

[[column]] # before 2016
to = "rates"
from = "vehicle_attitude:rollspeed,pitchspeed,yawspeed"
unit = "rad/s"

[[column]]
to = "accel"
from = "sensor_combined:accelerometer_m_s2[]"
unit = "m/s2"

[[column]]
to = "accel"
from = "vehicle_acceleration:xyz[]"
unit = "m/s2"

[[column]]
to = "quaternion"
from = "vehicle_attitude:q[]"
frame = "ned-frd"

[[column]] # before 2016
to = "attitude"
from = "vehicle_attitude:roll,pitch,yaw"
unit = "rad"

[[column]]
to = "position"
from = "vehicle_local_position:x,y,z"
unit = "m"
valid = "xy_valid"

[[column]]
to = "velocity"
from = "vehicle_local_position:vx,vy,vz"
unit = "m/s"
valid = "v_xy_valid"

[[column]]
to = "height_above_ground_m"
from = "vehicle_local_position:dist_bottom"
unit = "m"
valid = "dist_bottom_valid"

[[column]]
to = "duty"
from = "actuator_motors:control[]"

[[column]] # before 1.13: pulse widths of the main outputs, of which the motors come first
to = "duty"
from = "actuator_outputs:output[]"
low = { parameter = ["PWM_MAIN_MIN", "PWM_MIN"], default = 1000.0 }
high = { parameter = ["PWM_MAIN_MAX", "PWM_MAX"], default = 2000.0 }

# Outputs of another driver (ESCs on a CAN bus), taken where those of the first one stand still.
[[column]]
to = "duty"
from = "actuator_outputs#1:output[]"
low = { parameter = ["PWM_MAIN_MIN", "PWM_MIN"], default = 1000.0 }
high = { parameter = ["PWM_MAIN_MAX", "PWM_MAX"], default = 2000.0 }

[[column]]
to = "duty"
from = "actuator_outputs#2:output[]"
low = { parameter = ["PWM_MAIN_MIN", "PWM_MIN"], default = 1000.0 }
high = { parameter = ["PWM_MAIN_MAX", "PWM_MAX"], default = 2000.0 }

[[column]]
to = "rotor_speed"
from = "esc_status:esc[0].esc_rpm,esc[1].esc_rpm,esc[2].esc_rpm,esc[3].esc_rpm,esc[4].esc_rpm,esc[5].esc_rpm,esc[6].esc_rpm,esc[7].esc_rpm"
unit = "rpm"

[[column]]
to = "battery_voltage_v"
from = "battery_status:voltage_v"
unit = "V"

[[column]]
to = "battery_current_a"
from = "battery_status:current_a"
unit = "A"

[[column]]
to = "reference_position"
from = "trajectory_setpoint:position[]"
unit = "m"

[[column]]
to = "reference_position"
from = "vehicle_local_position_setpoint:x,y,z"
unit = "m"

[[column]]
to = "reference_yaw_rad"
from = "trajectory_setpoint:yaw"
unit = "rad"

[[column]]
to = "reference_yaw_rad"
from = "vehicle_local_position_setpoint:yaw"
unit = "rad"
`;export{e as default};