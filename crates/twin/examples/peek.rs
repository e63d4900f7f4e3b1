//! t
use rotortwin_plant::effects::*;
use rotortwin_plant::*;
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::predict::*;
fn main() {
    let d = VehicleDocuments::load("config/vehicles/f550.toml").unwrap();
    for name in ["04", "16"] {
        let l = FlightLog::read(format!("/work/shared/data/hidden_effect/log{name}.parquet").as_ref()).unwrap();
        let pr = Predictor::new(&d, &[], &Catalogue::built_in(), &l).unwrap();
        let mut base = [0.0; 16];
        for (id, p, v) in [
            ("mass", "relative", 1e-9),
            ("command-delay", "delay_s", 0.00125),
            ("command-delay", "delay_s", 0.0025),
            ("command-delay", "delay_s", 0.005),
            ("imu-latency", "delay_s", 0.00125),
            ("imu-latency", "delay_s", 0.0025),
            ("imu-latency", "delay_s", 0.005),
            ("motor-time-constant", "relative", 0.03),
            ("motor-time-constant", "relative", -0.03),
        ] {
            let r = match pr.residuals(&Nuisances::default(), &[EffectInstance::new(id, &[(p, v)])]) {
                Ok(r) => r,
                Err(e) => {
                    println!("{e}");
                    continue;
                }
            };
            print!("{id} {v}: ");
            for c in 0..12 {
                // demeaned in 5 s windows
                let w = &r.whitened[c];
                let mut s = 0.0;
                for b in w.chunks(2000) {
                    let m = b.iter().sum::<f64>() / b.len() as f64;
                    s += b.iter().map(|x| (x - m).powi(2)).sum::<f64>();
                }
                if v < 1e-8 {
                    base[c] = s;
                }
                print!("{} {:.0} ", NAMES[c], s - base[c]);
            }
            println!();
        }
    }
}
