//! Variables of user effects: what an expression can read of a moment, and their units.

use super::super::hooks::Moment;
use super::super::search::Requirement;
use super::units::Dimension;

macro_rules! variables {
    ($($name:literal $case:ident $dimension:ident $per_rotor:literal $meaning:literal => $value:expr;)*) => {
        /// A quantity that expressions can read.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(super) enum Variable {
            $($case,)*
        }

        impl Variable {
            /// Name, unit, meaning of all, for documents.
            pub(super) const ALL: &'static [(&'static str, Dimension, &'static str)] =
                &[$(($name, Dimension::$dimension, $meaning),)*];

            pub(super) fn named(name: &str) -> Option<Self> {
                match name {
                    $($name => Some(Self::$case),)*
                    _ => None,
                }
            }

            pub(super) fn dimension(self) -> Dimension {
                match self {
                    $(Self::$case => Dimension::$dimension,)*
                }
            }

            /// True if the value differs from rotor to rotor.
            pub(super) fn per_rotor(self) -> bool {
                match self {
                    $(Self::$case => $per_rotor,)*
                }
            }

            /// The value at a moment; `rotor` from 0 for quantities of a rotor.
            #[inline]
            pub(super) fn value(self, at: &Moment<'_>, rotor: usize) -> f64 {
                type Get = fn(&Moment<'_>, usize) -> f64;
                match self {
                    $(Self::$case => {
                        let get: Get = $value;
                        get(at, rotor)
                    })*
                }
            }
        }
    };
}

variables! {
    "time" Time TIME false "since the start" => |at, _| at.time_s;
    "air_velocity_x" AirX VELOCITY false "air velocity, body" => |at, _| at.air_velocity_body[0];
    "air_velocity_y" AirY VELOCITY false "air velocity, body" => |at, _| at.air_velocity_body[1];
    "air_velocity_z" AirZ VELOCITY false "air velocity, body" => |at, _| at.air_velocity_body[2];
    "airspeed" Airspeed VELOCITY false "length of the air velocity" => |at, _| crate::vector::length(at.air_velocity_body);
    "velocity_north" North VELOCITY false "velocity, NED" => |at, _| at.velocity_ned[0];
    "velocity_east" East VELOCITY false "velocity, NED" => |at, _| at.velocity_ned[1];
    "velocity_down" Down VELOCITY false "velocity, NED" => |at, _| at.velocity_ned[2];
    "position_north" PlaceNorth LENGTH false "position, NED" => |at, _| at.position_ned[0];
    "position_east" PlaceEast LENGTH false "position, NED" => |at, _| at.position_ned[1];
    "position_down" PlaceDown LENGTH false "position, NED" => |at, _| at.position_ned[2];
    "height_above_ground" Height LENGTH false "1e9 where no ground is in reach" => |at, _| at.height_above_ground.min(1e9);
    "roll_rate" RollRate RATE false "p" => |at, _| at.body_rates[0];
    "pitch_rate" PitchRate RATE false "q" => |at, _| at.body_rates[1];
    "yaw_rate" YawRate RATE false "r" => |at, _| at.body_rates[2];
    "angular_acceleration_x" SpinX RATE_OF_RATE false "body" => |at, _| at.angular_acceleration[0];
    "angular_acceleration_y" SpinY RATE_OF_RATE false "body" => |at, _| at.angular_acceleration[1];
    "angular_acceleration_z" SpinZ RATE_OF_RATE false "body" => |at, _| at.angular_acceleration[2];
    "specific_force_x" ForceX ACCELERATION false "body" => |at, _| at.specific_force[0];
    "specific_force_y" ForceY ACCELERATION false "body" => |at, _| at.specific_force[1];
    "specific_force_z" ForceZ ACCELERATION false "body" => |at, _| at.specific_force[2];
    "roll" Roll NONE false "rad" => |at, _| libm::atan2(at.ned_from_body[2][1], at.ned_from_body[2][2]);
    "pitch" Pitch NONE false "rad" => |at, _| libm::asin((-at.ned_from_body[2][0]).clamp(-1.0, 1.0));
    "yaw" Yaw NONE false "rad" => |at, _| libm::atan2(at.ned_from_body[1][0], at.ned_from_body[0][0]);
    "battery_voltage" Voltage VOLTAGE false "at the terminals" => |at, _| at.battery_voltage;
    "battery_current" Current CURRENT false "discharge positive" => |at, _| at.battery_current;
    "thrust" Thrust FORCE false "of all rotors" => |at, _| at.rotor_thrust.iter().sum();
    "mean_speed_ratio" MeanRatio NONE false "mean of the rotor speeds over hover speed" => |at, _| at.mean_speed_ratio();
    "mass" Mass MASS false "of the vehicle" => |at, _| at.constants.mass_kg;
    "gravity" Gravity ACCELERATION false "g" => |at, _| at.constants.gravity_m_s2;
    "hover_thrust" HoverThrust FORCE false "of one rotor" => |at, _| at.constants.hover_thrust_n;
    "hover_induced_velocity" Induced VELOCITY false "of one rotor" => |at, _| at.constants.hover_induced_velocity_m_s;
    "rotor_radius" Radius LENGTH false "R" => |at, _| at.constants.rotor_radius_m;
    "rotor_thrust" RotorThrust FORCE true "thrust of the rotor" => |at, i| at.rotor_thrust[i];
    "rotor_speed_ratio" Ratio NONE true "rotor speed over hover speed" => |at, i| at.rotor_speed_ratio[i];
    "rotor_speed_rate" RatioRate RATE true "rate of the speed ratio" => |at, i| at.rotor_speed_rate[i];
    "duty" Duty NONE true "commanded duty, fraction" => |at, i| at.duty[i];
    "rotor_x" RotorX LENGTH true "place of the rotor, body" => |at, i| at.constants.rotor_position_body[i][0];
    "rotor_y" RotorY LENGTH true "place of the rotor, body" => |at, i| at.constants.rotor_position_body[i][1];
    "rotor_spin" Spin NONE true "1 counter-clockwise seen from above, -1 clockwise" => |at, i| at.constants.rotor_spin[i];
    "rotor_air_velocity_x" RotorAirX VELOCITY true "air velocity at the rotor, body" => |at, i| at.rotor_air_velocity(i)[0];
    "rotor_air_velocity_y" RotorAirY VELOCITY true "air velocity at the rotor, body" => |at, i| at.rotor_air_velocity(i)[1];
    "rotor_air_velocity_z" RotorAirZ VELOCITY true "air velocity at the rotor, body" => |at, i| at.rotor_air_velocity(i)[2];
}

impl Variable {
    /// Requirements on a log for the variable to be known; `None` for what the model computes or what is a channel's
    /// own column.
    pub(super) fn requirement(self) -> Option<Requirement> {
        match self {
            Self::AirX
            | Self::AirY
            | Self::AirZ
            | Self::Airspeed
            | Self::North
            | Self::East
            | Self::Down
            | Self::RotorAirX
            | Self::RotorAirY
            | Self::RotorAirZ => Some(Requirement::AirVelocity),
            Self::PlaceNorth | Self::PlaceEast | Self::PlaceDown => Some(Requirement::Position),
            Self::Height => Some(Requirement::HeightAboveGround),
            Self::Voltage => Some(Requirement::BatteryVoltage),
            _ => None,
        }
    }
}
