//! Where on the Earth the origin of a flight is: WGS 84, and the standard atmosphere above it.
//!
//! North and east are turned into angles with the radii of curvature at home; within 1 km the position so found is off by less than
//! 20 cm (second order in the distance), the same wherever the vehicle has been before.

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, in_range};

/// Equatorial radius of WGS 84, m.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Square of the first eccentricity of WGS 84.
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_141_317e-3;

/// `instruments.home` of a scenario: the origin of NED.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Home {
    /// Degrees north.
    pub latitude_deg: f64,
    /// Degrees east.
    pub longitude_deg: f64,
    /// Above mean sea level, m.
    pub altitude_m: f64,
}

impl Default for Home {
    /// The place at which simulators of PX4 begin, near Zürich.
    fn default() -> Self {
        Self {
            latitude_deg: 47.397_742,
            longitude_deg: 8.545_594,
            altitude_m: 488.0,
        }
    }
}

impl Home {
    /// Rejects an invalid place for a flight; north and east lose their meaning beyond 85° of latitude.
    pub fn check(&self) -> Result<(), Refusal> {
        in_range("latitude_deg", self.latitude_deg, -85.0, 85.0, "degrees")?;
        in_range("longitude_deg", self.longitude_deg, -180.0, 180.0, "degrees")?;
        in_range("altitude_m", self.altitude_m, -500.0, 9000.0, "m")
    }

    /// Latitude and longitude, degrees, and altitude, m, of a position in m, NED.
    pub fn geodetic(&self, position_ned_m: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = libm::sincos(self.latitude_deg.to_radians());
        let flattened = 1.0 - ECCENTRICITY_SQUARED * sin * sin;
        let east_radius = SEMI_MAJOR_M / flattened.sqrt();
        let north_radius = east_radius * (1.0 - ECCENTRICITY_SQUARED) / flattened;
        let [north, east, down] = position_ned_m;
        [
            self.latitude_deg + (north / (north_radius + self.altitude_m)).to_degrees(),
            self.longitude_deg + (east / ((east_radius + self.altitude_m) * cos)).to_degrees(),
            self.altitude_m - down,
        ]
    }
}

/// Pressure, hPa, and temperature, °C, of the standard atmosphere at an altitude in m (ISO 2533, troposphere).
pub fn standard_atmosphere(altitude_m: f64) -> (f64, f64) {
    let temperature = 288.15 - 0.0065 * altitude_m;
    let pressure = 1013.25 * libm::pow(temperature / 288.15, 5.255_879_7);
    (pressure, temperature - 273.15)
}

/// Altitude, m, at which the standard atmosphere has a pressure in hPa.
pub fn pressure_altitude(pressure_hpa: f64) -> f64 {
    288.15 / 0.0065 * (1.0 - libm::pow(pressure_hpa / 1013.25, 1.0 / 5.255_879_7))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Latitude, longitude, altitude to the Earth-centred axes, m.
    fn earth_centred([latitude, longitude, altitude]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = latitude.to_radians().sin_cos();
        let (east, ahead) = longitude.to_radians().sin_cos();
        let radius = SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin * sin).sqrt();
        let across = (radius + altitude) * cos;
        [
            across * ahead,
            across * east,
            (radius * (1.0 - ECCENTRICITY_SQUARED) + altitude) * sin,
        ]
    }

    #[test]
    fn val_places_agree_with_the_ellipsoid() {
        let home = Home::default();
        let origin = earth_centred(home.geodetic([0.0; 3]));
        let (sin, cos) = home.latitude_deg.to_radians().sin_cos();
        let (east, ahead) = home.longitude_deg.to_radians().sin_cos();
        for (place, error) in [([100.0, -50.0, -20.0], 2e-3), ([1000.0, 1000.0, -50.0], 0.2)] {
            let there = earth_centred(home.geodetic(place));
            let d = [0, 1, 2].map(|i| there[i] - origin[i]);
            let found = [
                -sin * ahead * d[0] - sin * east * d[1] + cos * d[2],
                -east * d[0] + ahead * d[1],
                -(cos * ahead * d[0] + cos * east * d[1] + sin * d[2]),
            ];
            for axis in 0..3 {
                let off = (found[axis] - place[axis]).abs();
                assert!(off < error, "{place:?}: {off} m off along axis {axis}");
            }
        }
    }

    #[test]
    fn val_the_atmosphere_is_that_of_the_tables() {
        // ISO 2533, table 1: 0 m, 1000 m, 2000 m.
        for (altitude, pressure, temperature) in [(0.0, 1013.25, 15.0), (1000.0, 898.75, 8.5), (2000.0, 794.95, 2.0)] {
            let (p, t) = standard_atmosphere(altitude);
            assert!((p - pressure).abs() < 0.02 && (t - temperature).abs() < 1e-9, "{p} {t}");
            assert!((pressure_altitude(p) - altitude).abs() < 1e-6);
        }
    }
}
