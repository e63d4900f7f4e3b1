//! State estimate of a scripted PX4 from its sensors, shared by the tests of the link and of whole programs.

use rotortwin_bridge::mavlink::messages::{HilGps, HilSensor};
use std::collections::VecDeque;

/// Attitude from the gyroscope, position and velocity from acceleration and satellites; starts level, heading north.
pub(crate) struct Estimate {
    q: [f64; 4],
    pub(crate) position: [f64; 3],
    pub(crate) velocity: [f64; 3],
    /// The last 0.1 s, the age of a fix.
    history: VecDeque<([f64; 3], [f64; 3])>,
    home: Option<[f64; 3]>,
}

impl Estimate {
    pub(crate) fn new() -> Self {
        Self {
            q: [1.0, 0.0, 0.0, 0.0],
            position: [0.0, 0.0, -0.179],
            velocity: [0.0; 3],
            history: VecDeque::new(),
            home: None,
        }
    }

    fn rotate(&self, v: [f64; 3]) -> [f64; 3] {
        let [w, x, y, z] = self.q;
        let r = [
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ],
            [
                2.0 * (x * y + w * z),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - w * x),
            ],
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ];
        [0, 1, 2].map(|i| r[i][0] * v[0] + r[i][1] * v[1] + r[i][2] * v[2])
    }

    pub(crate) fn euler(&self) -> [f64; 3] {
        let [w, x, y, z] = self.q;
        [
            (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
            (2.0 * (w * y - z * x)).asin(),
            (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
        ]
    }

    pub(crate) fn inertial(&mut self, sample: &HilSensor, interval_s: f64) {
        let [p, q, r] = sample.gyro.map(f64::from);
        let [w, x, y, z] = self.q;
        let h = 0.5 * interval_s;
        let turned = [
            w + h * (-x * p - y * q - z * r),
            x + h * (w * p + y * r - z * q),
            y + h * (w * q + z * p - x * r),
            z + h * (w * r + x * q - y * p),
        ];
        let length = turned.iter().map(|x| x * x).sum::<f64>().sqrt();
        self.q = turned.map(|x| x / length);
        let mut acceleration = self.rotate(sample.acceleration.map(f64::from));
        acceleration[2] += 9.81;
        for i in 0..3 {
            self.velocity[i] += interval_s * acceleration[i];
            self.position[i] += interval_s * self.velocity[i];
        }
        self.history.push_back((self.position, self.velocity));
        if self.history.len() > 26 {
            self.history.pop_front();
        }
    }

    pub(crate) fn satellites(&mut self, fix: &HilGps) {
        let place = [fix.latitude, fix.longitude, fix.altitude].map(f64::from);
        let home = *self.home.get_or_insert(place);
        let metres = (1e-7_f64).to_radians() * 6_367_500.0;
        let east = metres * (home[0] * 1e-7).to_radians().cos();
        // The first fix was taken on the ground, 0.179 m above it.
        let found = [
            (place[0] - home[0]) * metres,
            (place[1] - home[1]) * east,
            -(place[2] - home[2]) * 1e-3 - 0.179,
        ];
        let Some((position, velocity)) = self.history.front() else {
            return;
        };
        let errors = [0, 1, 2].map(|i| (found[i] - position[i], f64::from(fix.velocity[i]) * 0.01 - velocity[i]));
        for (i, (place, speed)) in errors.into_iter().enumerate() {
            self.position[i] += 0.1 * place;
            self.velocity[i] += 0.1 * speed + 0.05 * place;
        }
    }
}
