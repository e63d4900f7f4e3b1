//! dev harness
use rotortwin_blind::bench::faults::{Class, FaultCase, FaultRow, draw_cases, fly_case, score};
use rotortwin_fdi_session::{Chunk, FdiSession, Sample, Window};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::{DetectorSettings, Detectors, VehicleDocuments};
use serde_json::json;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles/f550.toml");

fn samples(case: &FaultCase, cache: &str, key: &str) -> Vec<Sample> {
    let path = format!("{cache}/{key}.bin");
    const W: usize = 3 * 4 + 6 + 1;
    if let Ok(bytes) = std::fs::read(&path) {
        return bytes
            .chunks_exact(4 * W)
            .map(|b| {
                let f = |i: usize| f32::from_le_bytes(b[4 * i..4 * i + 4].try_into().unwrap());
                let v = |i: usize| [f(i), f(i + 1), f(i + 2)];
                let mut duty = [0.0; MAX_ROTORS];
                for (k, d) in duty.iter_mut().enumerate().take(6) {
                    *d = f(12 + k);
                }
                Sample {
                    position_ned_m: v(0),
                    velocity_ned_m_s: v(3),
                    attitude_rad: v(6),
                    body_rates_rad_s: v(9),
                    duty,
                    battery_voltage_v: f(18),
                    time_s: None,
                }
            })
            .collect();
    }
    let Ok(rows) = fly_case(case) else { return Vec::new() };
    let all: Vec<Sample> = rows.iter().map(sample).collect();
    if !cache.is_empty() {
        let mut out = Vec::with_capacity(all.len() * 4 * W);
        for s in &all {
            for x in s.position_ned_m.iter().chain(&s.velocity_ned_m_s).chain(&s.attitude_rad).chain(&s.body_rates_rad_s).chain(&s.duty[..6]).chain([&s.battery_voltage_v]) {
                out.extend_from_slice(&x.to_le_bytes());
            }
        }
        std::fs::write(&path, out).ok();
    }
    all
}

fn windows(samples: &[Sample]) -> (Vec<Window>, Vec<[f64; 12]>) {
    let documents = VehicleDocuments::load(VEHICLE).expect("shipped");
    let detectors = Detectors::new(documents, &DetectorSettings::default(), None).expect("a good configuration");
    let mut session = FdiSession::new(*detectors.config(), 1).expect("a good configuration");
    let mut windows = Vec::new();
    let mut debug = Vec::new();
    for (part, rows) in samples.chunks(25).enumerate() {
        let chunk = Chunk { first_step: 25 * part as u64, after_gap: false, samples: rows.to_vec() };
        
        for w in session.feed(&chunk).expect("taken").windows {
            windows.push(w);
            debug.push([0.0; 12]);
        }
    }
    (windows, debug)
}

fn sample(row: &rotortwin_blind::flight::Row) -> Sample {
    let numbers = |v: [f64; 3]| v.map(|x| x as f32);
    let mut duty = [0.0; MAX_ROTORS];
    for (to, from) in duty.iter_mut().zip(&row.duties) {
        *to = (*from as f32).clamp(0.0, 1.0);
    }
    Sample {
        position_ned_m: numbers(row.position.into()),
        velocity_ned_m_s: numbers(row.velocity.into()),
        attitude_rad: numbers(row.euler.into()),
        body_rates_rad_s: numbers(row.rates.into()),
        duty,
        battery_voltage_v: row.voltage as f32,
        time_s: None,
    }
}

fn code(window: &Window) -> i32 {
    if window.obstacle.is_some() { -4 } else { window.report.sequential }
}

fn view(window: &Window) -> serde_json::Value {
    let report = &window.report;
    let code = code(window);
    let rotors = match code { 1..100 => vec![code], 100.. => vec![code / 100, code % 100], _ => vec![] };
    let losses = rotors.iter().zip([report.thrust_loss, report.second_thrust_loss]);
    let losses = losses.map(|(rotor, loss)| json!({ "rotor": rotor, "share_low": loss.share_low, "share_high": loss.share_high }));
    let sets = report.hypothesis_rotors.iter().take(report.hypothesis_count as usize);
    let sets = sets.map(|mask| (1..=16).filter(|rotor| mask >> (rotor - 1) & 1 == 1).collect::<Vec<u32>>());
    json!({
        "smallest_loss": window.smallest_loss,
        "time_s": time_s(window),
        "sequential": { "code": code, "probability": report.sequential_probability,
            "thrust_loss": losses.collect::<Vec<_>>(), "hypotheses": sets.collect::<Vec<_>>() },
    })
}
fn time_s(window: &Window) -> f64 { window.report.stamp.sim_time_ns as f64 * 1e-9 }

fn wilson(k: usize, n: usize) -> String {
    if n == 0 { return "-".into(); }
    let (k, n, z) = (k as f64, n as f64, 1.96f64);
    let p = k / n;
    let c = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let h = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    format!("{k}/{n} = {:.1} % [{:.1}, {:.1}]", 100.0 * p, 100.0 * (c - h), 100.0 * (c + h))
}

fn main() {
    let get = |name: &str, default: &str| std::env::args().find_map(|a| a.strip_prefix(&format!("{name}=")).map(str::to_owned)).unwrap_or(default.to_owned());
    let classes = get("class", "five-healthy,five-step");
    let n: usize = get("n", "100").parse().unwrap();
    let seed: u64 = get("seed", "1").parse().unwrap();
    let duration: f64 = get("duration", "60").parse().unwrap();
    let jobs: usize = get("jobs", "2").parse().unwrap();
    let cache = get("cache", "");
    let stats = get("stats", "0") == "1";
    let trace = get("trace", "0") == "1";
    let all = draw_cases(n, seed, duration, &[(VEHICLE.to_owned(), 6)]);
    for class in classes.split(',') {
        let class: Class = serde_json::from_value(json!(class)).expect("a class");
        let cases: Vec<FaultCase> = all.iter().filter(|c| c.class == class).cloned().collect();
        if get("print", "0") == "1" {
            for c in &cases {
                let text: Vec<String> = c.effects.iter().filter(|e| e.onset_s.is_none()).map(|e| {
                    let mut parts: Vec<String> = e.rotor.map(|r| format!("rotor={r}")).into_iter().collect();
                    parts.extend(e.parameters.iter().map(|(k, v)| format!("{k}={v}")));
                    format!("--effect {}:{}", e.id, parts.join(","))
                }).collect();
                println!("{} {}", c.index, text.join(" "));
            }
            continue;
        }
        let next = AtomicUsize::new(0);
        let rows: Mutex<Vec<(usize, FaultRow)>> = Mutex::new(Vec::new());
        let started = std::time::Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    let Some(case) = cases.get(k) else { break };
                    let flown = samples(case, &cache, &format!("{class:?}-{seed}-{}-{duration}", case.index));
                    if flown.is_empty() { continue; }
                    let (windows, debug) = windows(&flown);
                    if stats {
                        let mut alarmed = false;
                        let onset = case.effects.iter().filter(|e| e.id == "rotor-thrust-scale").filter_map(|e| e.onset_s).fold(f64::INFINITY, f64::min);
                        let rotor = case.effects.iter().find(|e| e.id == "rotor-thrust-scale").and_then(|e| e.rotor).unwrap_or(0);
                        for (w, d) in windows.iter().zip(&debug) {
                            let c = code(w);
                            if c == -4 || c == -2 { continue; }
                            if c != 0 && !alarmed {
                                let kind = if time_s(w) < onset { "FALSE" } else { "true" };
                                let what = if c == -3 { "sets" } else if c as usize == rotor { "right" } else { "other" };
                                println!("S {class:?} {k} {kind} {what} t {:.2} z {:.1} share {:.3} sur {:.2} chi {:.0} R {:.2} R10 {:.2} peak {:.1} noth {:.4} now {:.1} eng {}", time_s(w), d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7], d[8], w.engine.sequential);
                            }
                            alarmed = c != 0;
                        }
                    }
                    let views: Vec<_> = windows.iter().map(view).collect();
                    let row = score(case, &json!({ "log": { "start_s": 0.0 }, "windows": views }).to_string()).expect("scored");
                    if stats && (get("every", "0") == "1" || row.inside == Some(false)) || stats && row.announced == Some(false) {
                        let e = case.effects.iter().find(|e| e.id == "rotor-thrust-scale").unwrap();
                        let w = windows.iter().rfind(|w| w.report.thrust_loss.share > 0.0);
                        let l = w.map(|w| w.report.thrust_loss).unwrap_or_default();
                        let onset = e.onset_s.unwrap();
                        let small = windows.iter().rfind(|w| time_s(w) < onset).and_then(|w| w.smallest_loss.get(e.rotor.unwrap() - 1).copied());
                        let d = debug.iter().rfind(|d| d[9] != 0.0).copied().unwrap_or_default();
                        println!("I {k} bias {:.4} gain {:.3} +- {:.3} {} truth {:.4} said {:.4} [{:.4} {:.4}] off {:.2} half widths, inside {:?} announced {:?} small {small:?} first {:?} {}", d[9], d[10], d[11], case.flight, -e.parameters["share"], l.share, l.share_low, l.share_high,
                            (l.share as f64 + e.parameters["share"]) / (0.5 * (l.share_high - l.share_low) as f64), row.inside, row.announced, row.first_s,
                            case.effects.iter().skip(3).map(|e| format!("{}{:?}", e.id, e.parameters.values().map(|x| (x * 1000.0).round() / 1000.0).collect::<Vec<_>>())).collect::<Vec<_>>().join(" "));
                    }
                    if trace && (row.false_alarms > 0 || row.healthy_named || row.announced == Some(false)) {
                        let mut text = format!("== {k} {:?} {} alarms {} named {}: {}\n", class, case.flight, row.false_alarms, row.healthy_named,
                            case.effects.iter().map(|e| format!("{}{}{:?}", e.id, e.onset_s.map_or(String::new(), |o| format!("@{o}")), e.parameters.values().map(|x| (x * 1000.0).round() / 1000.0).collect::<Vec<_>>())).collect::<Vec<_>>().join(" "));
                        let mut last = i32::MIN;
                        let mut count = 0;
                        for w in &windows {
                            let c = code(w);
                            if c != last && last != -2 && w.calibration == rotortwin_fdi_session::Calibration::Done || (c > 0 || c == -3) && count % 16 == 0 {
                                text += &format!("  {:6.2} engine {} code {c} p {:.3} share {:.3} [{:.3} {:.3}] sets {:?} {:?} small {:.3}\n", time_s(w), w.engine.sequential, w.report.sequential_probability, w.report.thrust_loss.share, w.report.thrust_loss.share_low, w.report.thrust_loss.share_high,
                                    &w.report.hypothesis_rotors[..w.report.hypothesis_count as usize], w.obstacle.map(|o| o.to_string().chars().take(30).collect::<String>()), w.smallest_loss.first().copied().unwrap_or(f32::NAN));
                                count = 0;
                            }
                            count += 1;
                            last = c;
                        }
                        print!("{text}");
                    }
                    rows.lock().unwrap().push((k, row));
                });
            }
        });
        let mut rows = rows.into_inner().unwrap();
        rows.sort_by_key(|r| r.0);
        let rows: Vec<FaultRow> = rows.into_iter().map(|r| r.1).collect();
        let alarms: usize = rows.iter().map(|r| r.false_alarms).sum();
        let hours: f64 = rows.iter().map(|r| r.healthy_s).sum::<f64>() / 3600.0;
        let decided: f64 = rows.iter().map(|r| r.decided_s).sum::<f64>();
        let flights = rows.iter().filter(|r| r.false_alarms > 0).count();
        let found = rows.iter().filter(|r| r.first_s.is_some_and(|s| s <= 10.0)).count();
        let misses = rows.iter().filter(|r| r.announced.is_some()).count();
        let ends = |e: &str| rows.iter().filter(|r| r.end.is_some_and(|x| serde_json::to_value(x).unwrap() == json!(e))).count();
        let sum = |f: &dyn Fn(&FaultRow) -> usize| rows.iter().map(f).sum::<usize>();
        println!("{class:?} seed {seed} n {} ({:.0} s): alarms {alarms} in {hours:.2} h = {:.2}/h, flights {flights}; decided {:.3}; healthy named {}", rows.len(), started.elapsed().as_secs_f64(), alarms as f64 / hours, decided / (rows.len() as f64 * (duration - 10.0)), wilson(sum(&|r| r.healthy_named as usize), rows.len()));
        println!("   found {}  announced {}  inside {}  still {} moving {} released1 {}  ends right {} set {} open {} missed {} wrong {}", wilson(found, rows.len()),
            wilson(sum(&|r| (r.announced == Some(true)) as usize), misses), wilson(sum(&|r| (r.inside == Some(true)) as usize), sum(&|r| r.inside.is_some() as usize)),
            wilson(sum(&|r| r.still.inside), sum(&|r| r.still.of)), wilson(sum(&|r| r.moving.inside), sum(&|r| r.moving.of)),
            sum(&|r| r.released_s.is_some_and(|s| s <= 1.0) as usize),
            ends("right"), ends("in-set"), ends("open"), ends("missed"), ends("wrong"));
    }
}
