var e=`# Betaflight, INAV blackbox (.bbl, .bfl, .TXT, and the CSV of blackbox_decode) → canonical flight log. Keys of a row: see px4-ulog.toml.
# Body axes forward, left, up. Fields in units are made by the reader from the header (gyro_scale, acc_1G, motorOutput, firmware).

source = "blackbox"
base = ["main"]

[[column]]
to = "rates"
from = "main:gyro[0],gyro[1],gyro[2]"
unit = "deg/s"
frame = "flu"

[[column]]
to = "accel"
from = "main:acc[0],acc[1],acc[2]"
unit = "g"
frame = "flu"

[[column]] # INAV
to = "attitude"
from = "main:euler[0],euler[1],euler[2]"
unit = "deg"

[[column]] # INAV
to = "position"
from = "main:position[0],position[1],position[2]"
unit = "m"

[[column]] # INAV
to = "velocity"
from = "main:velocity[0],velocity[1],velocity[2]"
unit = "m/s"

[[column]]
to = "duty"
from = "main:motor[]"
low = { parameter = ["motor_low"], default = 1000.0 }
high = { parameter = ["motor_high"], default = 2000.0 }

[[column]] # eRPM of bidirectional DShot, by motor_poles of the header
to = "rotor_speed"
from = "main:rpm[]"
unit = "rpm"

[[column]]
to = "battery_voltage_v"
from = "main:voltage_v"
unit = "V"

[[column]]
to = "battery_current_a"
from = "main:current_a"
unit = "A"

[[column]] # cm
to = "barometer_height_m"
from = "main:BaroAlt"
unit = "cm"
`;export{e as default};