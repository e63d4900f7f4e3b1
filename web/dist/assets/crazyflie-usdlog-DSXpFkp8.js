var e=`# Crazyflie micro-SD log → canonical flight log. Keys of a row: see px4-ulog.toml.
# The Crazyflie's body is forward-left-up and its world x forward, y left, z up at the start; the canonical north is its x.
# Exceptions, from its firmware: \`stateEstimate.pitch\`, \`controller.pitch\` and \`controller.r_pitch\` are already positive nose up.

source = "crazyflie-usdlog"
base = ["fixedFrequency"]
keep_rest = true # every other variable stays, under its own name

[[column]]
to = "rates"
from = "fixedFrequency:gyro.x,gyro.y,gyro.z"
unit = "deg/s"
frame = "flu"

[[column]] # rad/s, axes of ctrlLee
to = "rates"
from = "fixedFrequency:ctrlLee.omegax,ctrlLee.omegay,ctrlLee.omegaz"
unit = "rad/s"
frame = "flu"

[[column]]
to = "roll_rate_rad_s"
from = "fixedFrequency:controller.r_roll"
unit = "rad/s"

[[column]]
to = "pitch_rate_rad_s"
from = "fixedFrequency:controller.r_pitch"
unit = "rad/s"

[[column]]
to = "yaw_rate_rad_s"
from = "fixedFrequency:controller.r_yaw"
unit = "rad/s"
factor = -1.0

[[column]]
to = "accel"
from = "fixedFrequency:acc.x,acc.y,acc.z"
unit = "g"
frame = "flu"

[[column]]
to = "accel_z_m_s2"
from = "fixedFrequency:controller.accelz"
unit = "g"
factor = -1.0

[[column]]
to = "attitude"
from = "fixedFrequency:ctrlLee.rpyx,ctrlLee.rpyy,ctrlLee.rpyz"
unit = "rad"
frame = "nwu-flu"

[[column]]
to = "roll_rad"
from = "fixedFrequency:stateEstimate.roll"
unit = "deg"

[[column]]
to = "pitch_rad"
from = "fixedFrequency:stateEstimate.pitch"
unit = "deg"

[[column]]
to = "yaw_rad"
from = "fixedFrequency:stateEstimate.yaw"
unit = "deg"
factor = -1.0

[[column]]
to = "position"
from = "fixedFrequency:stateEstimate.x,stateEstimate.y,stateEstimate.z"
unit = "m"
frame = "nwu"

[[column]]
to = "position"
from = "fixedFrequency:stateEstimateZ.x,stateEstimateZ.y,stateEstimateZ.z"
unit = "mm"
frame = "nwu"

[[column]]
to = "velocity"
from = "fixedFrequency:stateEstimate.vx,stateEstimate.vy,stateEstimate.vz"
unit = "m/s"
frame = "nwu"

[[column]]
to = "velocity"
from = "fixedFrequency:stateEstimateZ.vx,stateEstimateZ.vy,stateEstimateZ.vz"
unit = "mm/s"
frame = "nwu"

[[column]] # the duty after the firmware's battery compensation
to = "duty"
from = "fixedFrequency:pwm.m1_pwm,pwm.m2_pwm,pwm.m3_pwm,pwm.m4_pwm"
high = 65535.0

[[column]]
to = "duty"
from = "fixedFrequency:motor.m1,motor.m2,motor.m3,motor.m4"
high = 65535.0

[[column]]
to = "battery_voltage_v"
from = "fixedFrequency:pm.vbatMV"
unit = "mV"

[[column]]
to = "battery_voltage_v"
from = "fixedFrequency:pm.vbat"
unit = "V"

[[column]]
to = "height_above_ground_m"
from = "fixedFrequency:range.zrange"
unit = "mm"

[[column]]
to = "reference_position"
from = "fixedFrequency:ctrltarget.x,ctrltarget.y,ctrltarget.z"
unit = "m"
frame = "nwu"

[[column]]
to = "reference_position"
from = "fixedFrequency:ctrltargetZ.x,ctrltargetZ.y,ctrltargetZ.z"
unit = "mm"
frame = "nwu"

[[column]]
to = "thrust_command_n"
from = "fixedFrequency:ctrlLee.thrustSI"
unit = "N"

[[column]] # older firmware
to = "thrust_command_n"
from = "fixedFrequency:ctrlLee.thrustSi"
unit = "N"

[[column]]
to = "torque_command"
from = "fixedFrequency:ctrlLee.torquex,ctrlLee.torquey,ctrlLee.torquez"
unit = "N.m"
frame = "flu"
`;export{e as default};