//! t
use rotortwin_plant::effects::*;
use rotortwin_plant::*;
use rotortwin_twin::log::FlightLog;
use rotortwin_twin::predict::*;
fn main() {
    let d = VehicleDocuments::load("config/vehicles/f550.toml").unwrap();
    let l = FlightLog::read("/work/shared/data/hidden_effect/log01.parquet".as_ref()).unwrap();
    let pr = Predictor::new(&d, &[], &Catalogue::built_in(), &l).unwrap();
    for e in [vec![], vec![EffectInstance::new("rotor-drag", &[("drag_n_s_m", 0.25)])], vec![EffectInstance::new("linear-friction", &[("drag_kg_s", 0.25)])]] {
        let r = match pr.residuals(&Nuisances::default(), &e) { Ok(r) => r, Err(e) => { println!("{e}"); continue; } };
        for c in 0..9 {
            let w = &r.whitened[c];
            let n = r.mask[c].iter().filter(|&&m| m).count() as f64;
            print!("{} {:.4} ", NAMES[c], w.iter().map(|v| v * v).sum::<f64>() / n);
        }
        println!();
    }
}
