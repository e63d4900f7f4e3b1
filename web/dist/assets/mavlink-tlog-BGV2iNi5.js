var e=`# MAVLink telemetry log (.tlog) → canonical flight log. Keys of a row: see px4-ulog.toml.
# Units and frames: MAVLink's common.xml (body FRD, world NED).

source = "mavlink-tlog"
base = ["HIGHRES_IMU", "ATTITUDE"]

[[column]] # PX4
to = "rates"
from = "HIGHRES_IMU:xgyro,ygyro,zgyro"
unit = "rad/s"

[[column]]
to = "rates"
from = "ATTITUDE:rollspeed,pitchspeed,yawspeed"
unit = "rad/s"

[[column]] # PX4
to = "accel"
from = "HIGHRES_IMU:xacc,yacc,zacc"
unit = "m/s2"

[[column]]
to = "accel"
from = "SCALED_IMU:xacc,yacc,zacc"
unit = "mg"

[[column]] # ArduPilot sends it in thousandths of g
to = "accel"
from = "RAW_IMU:xacc,yacc,zacc"
unit = "mg"

[[column]]
to = "attitude"
from = "ATTITUDE:roll,pitch,yaw"
unit = "rad"

[[column]]
to = "position"
from = "LOCAL_POSITION_NED:x,y,z"
unit = "m"

[[column]]
to = "velocity"
from = "LOCAL_POSITION_NED:vx,vy,vz"
unit = "m/s"

[[column]] # no local position in the link
to = "velocity"
from = "GLOBAL_POSITION_INT:vx,vy,vz"
unit = "cm/s"

[[column]]
to = "duty"
from = "SERVO_OUTPUT_RAW:servo{}_raw"
low = { parameter = ["MOT_PWM_MIN", "PWM_MAIN_MIN", "RC3_MIN"], default = 1000.0 }
high = { parameter = ["MOT_PWM_MAX", "PWM_MAIN_MAX", "RC3_MAX"], default = 2000.0 }

[[column]]
to = "battery_voltage_v"
from = "SYS_STATUS:voltage_battery"
unit = "mV"

[[column]] # -1 where nothing measures it
to = "battery_current_a"
from = "SYS_STATUS:current_battery"
unit = "cA"
`;export{e as default};