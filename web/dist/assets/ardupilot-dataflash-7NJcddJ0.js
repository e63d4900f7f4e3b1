var e=`# ArduPilot DataFlash, binary (.bin) and text (.log) → canonical flight log. Keys of a row: see px4-ulog.toml.
# Units and frames: LogStructure.h of ArduPilot (body FRD, world NED; angles in degrees).

source = "ardupilot-dataflash"
base = ["IMU", "IMU#0", "ANG", "ATT"]

[[column]]
to = "rates"
from = "IMU:GyrX,GyrY,GyrZ"
unit = "rad/s"

[[column]]
to = "accel"
from = "IMU:AccX,AccY,AccZ"
unit = "m/s2"

[[column]] # fast attitude since 4.7: a message of its own at the rate of the loop, beside ATT at 10 Hz
to = "attitude"
from = "ANG:Roll,Pitch,Yaw"
unit = "deg"

[[column]]
to = "attitude"
from = "ATT:Roll,Pitch,Yaw"
unit = "deg"

# Where neither is logged: what the estimators say (EKF3, EKF2, EKF1), else the second attitude that the autopilot keeps.
[[column]]
to = "attitude"
from = "XKF1:Roll,Pitch,Yaw"
unit = "deg"

[[column]]
to = "attitude"
from = "NKF1:Roll,Pitch,Yaw"
unit = "deg"

[[column]]
to = "attitude"
from = "EKF1:Roll,Pitch,Yaw"
unit = "deg"

[[column]]
to = "attitude"
from = "AHR2:Roll,Pitch,Yaw"
unit = "deg"

[[column]] # EKF3
to = "position"
from = "XKF1:PN,PE,PD"
unit = "m"

[[column]] # EKF2
to = "position"
from = "NKF1:PN,PE,PD"
unit = "m"

[[column]]
to = "position"
from = "EKF1:PN,PE,PD"
unit = "m"

[[column]] # no estimator in the log
to = "position"
from = "GPS:Lat,Lng,Alt"
unit = "1"
frame = "geodetic"

[[column]]
to = "velocity"
from = "XKF1:VN,VE,VD"
unit = "m/s"

[[column]]
to = "velocity"
from = "NKF1:VN,VE,VD"
unit = "m/s"

[[column]]
to = "velocity"
from = "EKF1:VN,VE,VD"
unit = "m/s"

# SERVOn_MIN and _MAX are not those of motors. AP_MotorsMulticopter::get_pwm_output_min takes MOT_PWM_MIN, or the throttle channel's
# range where that is 0.
[[column]]
to = "duty"
from = "RCOU:C{}"
low = { parameter = ["MOT_PWM_MIN", "RC3_MIN"], default = 1000.0 }
high = { parameter = ["MOT_PWM_MAX", "RC3_MAX"], default = 2000.0 }

[[column]]
to = "duty"
from = "RCOU:Ch{}"
low = { parameter = ["RC3_MIN"], default = 1000.0 }
high = { parameter = ["RC3_MAX"], default = 2000.0 }

[[column]] # 3.2 and before
to = "duty"
from = "RCOU:Chan{}"
low = { parameter = ["RC3_MIN"], default = 1000.0 }
high = { parameter = ["RC3_MAX"], default = 2000.0 }

[[column]] # before 2014
to = "duty"
from = "MOT:Mot{}"
low = { parameter = ["RC3_MIN"], default = 1000.0 }
high = { parameter = ["RC3_MAX"], default = 2000.0 }

[[column]]
to = "battery_voltage_v"
from = "BAT:Volt"
unit = "V"

[[column]] # volts since 3.4, hundredths before
to = "battery_voltage_v"
from = "CURR:Volt"
unit = ["V", "cV"]

[[column]]
to = "battery_current_a"
from = "BAT:Curr"
unit = "A"

[[column]] # hundredths where the voltage of the same message is
to = "battery_current_a"
from = "CURR:Curr"
unit = ["A", "cA"]
unit_as = { field = "Volt", unit = ["V", "cV"] }

[[column]]
to = "height_above_ground_m"
from = "RFND:Dist"
unit = "m"

[[column]]
to = "height_above_ground_m"
from = "RFND:Dist1"
unit = "m"

# Height of the barometer and the collective throttle: names of our own, kept for plots and as regressors.
[[column]]
to = "barometer_height_m"
from = "BARO:Alt"
unit = "m"

[[column]]
to = "barometer_height_m"
from = "CTUN:BarAlt"
unit = "m"

[[column]]
to = "throttle_fraction"
from = "CTUN:ThO"
unit = "1"

[[column]] # 0 to 1000 before 3.4
to = "throttle_fraction"
from = "CTUN:ThrOut"
unit = "permille"
`;export{e as default};