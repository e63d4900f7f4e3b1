//! One clock for all topics.
//!
//! A message has up to two times: its own stamp (`header.stamp`, or `timestamp` of `px4_msgs`), which is when it was
//! measured, and when it was recorded, which is later by the delay of queue and network. Stamps are preferred, each on
//! its own clock: the computer's, the autopilot's since its start, the simulator's. If topics are stamped by several
//! clocks, each is shifted to the recorder's by the smallest delay observed; a topic without stamps has the recorder's
//! times.

use super::Topic;

/// Stamps whose median delay differs by less are of one clock, ns.
const SAME_CLOCK_NS: i64 = 2_000_000_000;
/// Share of the stamps that must increase.
const INCREASING: f64 = 0.9;

/// Stamps of a topic, ns; `None`: it has none that could be.
fn stamps(topic: &Topic) -> Option<Vec<i64>> {
    let plan = topic.plan.as_ref()?;
    let column = |field: &str| plan.place(field).map(|place| &topic.columns[place]);
    let stamps: Vec<i64> = match (
        column("header.stamp.sec"),
        column("header.stamp.nanosec"),
        column("timestamp"),
    ) {
        (Some(seconds), Some(nanoseconds), _) => seconds
            .iter()
            .zip(nanoseconds)
            .map(|(seconds, nanoseconds)| {
                (*seconds as i64)
                    .saturating_mul(1_000_000_000)
                    .saturating_add(*nanoseconds as i64)
            })
            .collect(),
        (_, _, Some(micros)) if topic.kind.starts_with("px4_msgs/") => micros
            .iter()
            .map(|micros| (*micros as i64).saturating_mul(1000))
            .collect(),
        _ => return None,
    };
    let increase = stamps.windows(2).filter(|pair| pair[1] > pair[0]).count();
    let possible = stamps.len() < 2 || increase as f64 >= INCREASING * (stamps.len() - 1) as f64;
    (possible && stamps.iter().all(|stamp| *stamp > 0)).then_some(stamps)
}

/// Of a topic: its stamps, how much later the middle message was recorded, and the least that any was.
struct Stamped {
    stamps: Vec<i64>,
    middle_ns: i64,
    least_ns: i64,
}

fn stamped(topic: &Topic) -> Option<Stamped> {
    let stamps = stamps(topic)?;
    let mut late: Vec<i64> = topic
        .recorded_ns
        .iter()
        .zip(&stamps)
        .map(|(recorded, stamp)| recorded.saturating_sub(*stamp))
        .collect();
    late.sort_unstable();
    Some(Stamped {
        middle_ns: late[late.len() / 2],
        least_ns: late[0],
        stamps,
    })
}

/// Times of every topic, s since the first one, and the clock's reading at that time, s.
pub(super) fn one_clock(topics: &[Topic], notes: &mut Vec<String>) -> (Vec<Vec<f64>>, f64) {
    let all: Vec<Option<Stamped>> = topics.iter().map(stamped).collect();
    // Delays in order; where they jump another clock begins. The recorder's own has none.
    let unstamped = all.iter().any(Option::is_none);
    let mut delays: Vec<i64> = all.iter().flatten().map(|one| one.middle_ns).collect();
    delays.extend(unstamped.then_some(0));
    delays.sort_unstable();
    let clock_of = |delay: i64| {
        let before = delays.windows(2).filter(|pair| pair[1] <= delay);
        before.filter(|pair| pair[1] - pair[0] > SAME_CLOCK_NS).count()
    };
    let clocks = delays.last().map_or(0, |last| clock_of(*last) + 1);
    if clocks > 1 {
        notes.push(format!(
            "stamps of {clocks} clocks; each is put onto the recorder's by the least delay that was seen, so delays between their topics are not known"
        ));
    }
    let without: Vec<&str> = topics
        .iter()
        .zip(&all)
        .filter(|(_, one)| one.is_none())
        .map(|(topic, _)| topic.name.as_str())
        .collect();
    if !without.is_empty() && without.len() < topics.len() {
        notes.push(format!(
            "without stamps of their own, so with the times of their recording: {}",
            without.join(", ")
        ));
    } else if !without.is_empty() {
        notes.push("no message has a stamp of its own: times are those of the recording".to_owned());
    }
    let least_of = |clock: usize| {
        let of_it = all.iter().flatten().filter(|one| clock_of(one.middle_ns) == clock);
        of_it.map(|one| one.least_ns).min().unwrap_or(0)
    };
    let times_ns: Vec<Vec<i64>> = topics
        .iter()
        .zip(&all)
        .map(|(topic, one)| match one {
            None => topic.recorded_ns.clone(),
            Some(one) if clocks <= 1 => one.stamps.clone(),
            Some(one) => {
                let clock = clock_of(one.middle_ns);
                // The recorder's clock stays as it is.
                let moved = if unstamped && clock == clock_of(0) {
                    0
                } else {
                    least_of(clock)
                };
                one.stamps.iter().map(|stamp| stamp.saturating_add(moved)).collect()
            }
        })
        .collect();
    let first = times_ns.iter().flatten().copied().min().unwrap_or(0);
    let seconds = |times: &Vec<i64>| {
        times
            .iter()
            .map(|time| 1e-9 * time.saturating_sub(first) as f64)
            .collect()
    };
    (times_ns.iter().map(seconds).collect(), 1e-9 * first as f64)
}
