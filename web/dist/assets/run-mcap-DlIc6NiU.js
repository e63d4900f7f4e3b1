var e=`# run.mcap of this program → canonical flight log. Keys of a row: see px4-ulog.toml; messages: proto/rotortwin/v1/telemetry.proto.
# Single precision; the run folder (telemetry.parquet) has the values in full, and instruments that this file has not.

source = "run-mcap"
base = ["rotortwin.v1.NavTelemetry"]

[[column]]
to = "rates"
from = "rotortwin.v1.NavTelemetry:body_rates_rad_s.forward,body_rates_rad_s.right,body_rates_rad_s.down"
unit = "rad/s"

[[column]]
to = "attitude"
from = "rotortwin.v1.NavTelemetry:attitude.roll_rad,attitude.pitch_rad,attitude.yaw_rad"
unit = "rad"

[[column]]
to = "position"
from = "rotortwin.v1.NavTelemetry:position_ned_m.north,position_ned_m.east,position_ned_m.down"
unit = "m"

[[column]]
to = "velocity"
from = "rotortwin.v1.NavTelemetry:velocity_ned_m_s.north,velocity_ned_m_s.east,velocity_ned_m_s.down"
unit = "m/s"

[[column]]
to = "duty"
from = "rotortwin.v1.CommandTelemetry:duty[]"

[[column]]
to = "battery_voltage_v"
from = "rotortwin.v1.BatteryTelemetry:voltage_v"
unit = "V"

[[column]]
to = "battery_current_a"
from = "rotortwin.v1.BatteryTelemetry:current_a"
unit = "A"

[[column]]
to = "reference_position"
from = "rotortwin.v1.ReferenceTelemetry:position_ned_m.north,position_ned_m.east,position_ned_m.down"
unit = "m"

[[column]]
to = "reference_yaw_rad"
from = "rotortwin.v1.ReferenceTelemetry:yaw_rad"
unit = "rad"
`;export{e as default};