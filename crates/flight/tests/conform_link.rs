//! Controllers that violate the link protocol: repeated answers, skipped steps, steps never requested, refusals.

use rotortwin_flight::conform::{Demands, Fault, Report, conform};
use rotortwin_links::endpoint::{Delivery, Endpoint, EndpointLink, Packet};
use rotortwin_proto::setup::Parameters;
use rotortwin_proto::{Join, Ready, Role};
use rotortwin_scenario::Scenario;
use rotortwin_wire::PROTOCOL_VERSION;
use rotortwin_wire::frames::FdiReport;
use rotortwin_wire::link::{ControllerPeer as _, LinkError, LinkTiming};
use rotortwin_wire::peers::PidPeer;
use std::collections::VecDeque;
use std::time::Duration;

const RUN_ID: u64 = 7;

/// Deviation from a correct controller.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Breach {
    None,
    /// Answers this step three times.
    Repeats(u64),
    /// Answers each step twice.
    Echoes,
    /// Skips this step.
    Skips(u64),
    /// Answers this step as if it were five later.
    RunsAhead(u64),
    /// Exits at this step.
    Dies(u64),
    Refuses,
    OldVersion,
}

/// The plant's end of a link with our controller at the other end, in this thread.
struct Scripted {
    breach: Breach,
    inbox: VecDeque<Packet>,
    controller: PidPeer,
    gone: bool,
}

impl Scripted {
    fn new(breach: Breach) -> Self {
        let join = |role: Role, version| {
            Packet::Join(Join {
                run_id: RUN_ID,
                role: role.into(),
                protocol_version: version,
                program: "scripted".to_owned(),
                ..Join::default()
            })
        };
        let version = if breach == Breach::OldVersion {
            0
        } else {
            PROTOCOL_VERSION
        };
        Self {
            breach,
            inbox: VecDeque::from([join(Role::Controller, version), join(Role::Fdi, PROTOCOL_VERSION)]),
            controller: PidPeer::default(),
            gone: false,
        }
    }

    fn ready(&mut self, role: Role, refusal: &str) {
        self.inbox.push_back(Packet::Ready(Ready {
            run_id: RUN_ID,
            role: role.into(),
            refusal: refusal.to_owned(),
        }));
    }
}

impl Endpoint for Scripted {
    fn role(&self) -> Role {
        Role::Plant
    }

    fn run_id(&self) -> u64 {
        RUN_ID
    }

    fn transport(&self) -> &'static str {
        "test"
    }

    fn address(&self) -> String {
        "here".to_owned()
    }

    fn send(&mut self, packet: &Packet) -> Result<Delivery, LinkError> {
        match packet {
            Packet::Setup(setup) => match &setup.parameters {
                Some(Parameters::Controller(parameters)) => {
                    self.controller.setup(parameters).expect("it flies");
                    let refusal = if self.breach == Breach::Refuses {
                        "I do not want to"
                    } else {
                        ""
                    };
                    self.ready(Role::Controller, refusal);
                }
                _ => self.ready(Role::Fdi, ""),
            },
            Packet::Sensors(sensors) => {
                let step = sensors.stamp.step;
                let report = FdiReport {
                    stamp: sensors.stamp,
                    ..FdiReport::default()
                };
                self.inbox.push_back(Packet::Report(report));
                let mut command = self.controller.step(sensors);
                let answers = match self.breach {
                    Breach::Repeats(at) if step == at => 3,
                    Breach::Echoes => 2,
                    Breach::Skips(at) if step == at => 0,
                    Breach::Dies(at) if step >= at => {
                        self.gone = true;
                        0
                    }
                    Breach::RunsAhead(at) if step == at => {
                        command.stamp.step += 5;
                        1
                    }
                    _ => 1,
                };
                for _ in 0..answers {
                    self.inbox.push_back(Packet::Command(command));
                }
            }
            _ => {}
        }
        Ok(Delivery::Complete)
    }

    fn wake(&mut self, _: Role) -> Result<(), LinkError> {
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Packet>, LinkError> {
        Ok(self.inbox.pop_front())
    }

    fn wait(&mut self, at_most: Duration) -> Result<(), LinkError> {
        std::thread::sleep(at_most);
        Ok(())
    }

    fn is_gone(&mut self, role: Role, _: bool) -> bool {
        role == Role::Controller && self.gone
    }
}

fn examine(breach: Breach) -> Report {
    let path = format!("{}/../../config/scenarios/short-hover.toml", env!("CARGO_MANIFEST_DIR"));
    let scenario = Scenario::load_with(path, &["duration_s=60"]).expect("a good scenario");
    let timing = LinkTiming {
        join: Duration::from_millis(500),
        step: Duration::from_millis(200),
        ..LinkTiming::default()
    };
    let mut link = EndpointLink::new(Scripted::new(breach), timing);
    conform(&mut link, &scenario, 1, RUN_ID, &Demands::default()).expect("the kit itself works")
}

#[test]
fn scenario_breaches_of_the_protocol_are_named() {
    assert_eq!(examine(Breach::None).findings, []);
    for (breach, fault, words) in [
        (Breach::Repeats(900), Fault::Duplicate, "answered more than once"),
        (Breach::Echoes, Fault::Duplicate, "answered more than once"),
        (Breach::Skips(1234), Fault::MissedStep, "no answer to step 1234"),
        (Breach::Skips(0), Fault::MissedStep, "no answer to step 0"),
        (
            Breach::RunsAhead(50),
            Fault::MissedStep,
            "a step that was not requested",
        ),
        (Breach::Dies(777), Fault::Refusal, "it ended"),
        (Breach::Refuses, Fault::Refusal, "refused"),
        (Breach::OldVersion, Fault::Refusal, "refused"),
    ] {
        let report = examine(breach);
        let [finding] = &report.findings[..] else {
            panic!("{breach:?}: {:?}", report.findings)
        };
        assert!(
            finding.fault == fault && finding.sentence.contains(words),
            "{breach:?}: {finding:?}"
        );
    }
}
