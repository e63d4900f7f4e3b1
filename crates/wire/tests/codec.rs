//! Conversion between native frames and messages: lossless, and robust against invalid input.

use proptest::prelude::*;
use prost::Message;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_proto::{self as proto, verdict::Kind};
use rotortwin_wire::convert::{check_command, check_report, check_sensors};
use rotortwin_wire::frames::{CommandFrame, FdiReport, LossEstimate, MAX_HYPOTHESES, SensorFrame, Stamp};

/// Finite numbers of every magnitude, including subnormals and zeros of both signs.
fn finite() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => any::<u32>().prop_map(f32::from_bits).prop_filter("finite", |x| x.is_finite()),
        1 => Just(-0.0_f32),
        1 => -100.0_f32..100.0,
    ]
}

fn stamp() -> impl Strategy<Value = Stamp> {
    (1..=u64::MAX, 0..(1_u64 << 63), 0..(1_u64 << 63)).prop_map(|(run_id, step, sim_time_ns)| Stamp {
        run_id,
        step,
        sim_time_ns,
    })
}

fn sensor_frame() -> impl Strategy<Value = SensorFrame> {
    (stamp(), proptest::array::uniform20(finite())).prop_map(|(stamp, x)| SensorFrame {
        stamp,
        position_ned_m: [x[0], x[1], x[2]],
        velocity_ned_m_s: [x[3], x[4], x[5]],
        attitude_rad: [x[6], x[7], x[8]],
        body_rates_rad_s: [x[9], x[10], x[11]],
        reference_position_ned_m: [x[12], x[13], x[14]],
        reference_velocity_ned_m_s: [x[15], x[16], x[17]],
        reference_yaw_rad: x[18],
        battery_voltage_v: x[19],
    })
}

fn rotor_count() -> impl Strategy<Value = usize> {
    4..=MAX_ROTORS
}

fn command_frame() -> impl Strategy<Value = (usize, CommandFrame)> {
    (
        rotor_count(),
        stamp(),
        proptest::array::uniform16(prop_oneof![0.0_f32..=1.0, Just(0.0), Just(-0.0), Just(1.0)]),
        proptest::array::uniform3(finite()),
        any::<u32>(),
    )
        .prop_map(
            |(rotor_count, stamp, mut duty, attitude_setpoint_rad, saturated_rotors)| {
                duty[rotor_count..].fill(0.0);
                (
                    rotor_count,
                    CommandFrame {
                        stamp,
                        duty,
                        attitude_setpoint_rad,
                        saturated_rotors,
                    },
                )
            },
        )
}

/// A loss inside its interval.
fn loss() -> impl Strategy<Value = LossEstimate> {
    proptest::array::uniform6(0.0_f32..1e3).prop_map(|mut values| {
        values[..3].sort_by(f32::total_cmp);
        values[3..].sort_by(f32::total_cmp);
        let [low_n, loss_n, high_n, share_low, share, share_high] = values;
        LossEstimate {
            loss_n,
            low_n,
            high_n,
            share,
            share_low,
            share_high,
        }
    })
}

fn fdi_report() -> impl Strategy<Value = (usize, FdiReport)> {
    rotor_count().prop_flat_map(move |rotor_count| {
        let code = -2..=rotor_count as i32;
        (
            stamp(),
            proptest::array::uniform16(proptest::array::uniform3(finite())),
            proptest::array::uniform4(finite()),
            [code.clone(), code.clone(), code],
            (0.0_f32..=1.0, loss(), loss(), 0..=1_u32),
            (0..1_u32 << rotor_count, 0..20_u32, 1..1_u32 << rotor_count, 0..4_u8),
        )
            .prop_map(
                move |(stamp, mut residuals_nms, wrench_residual, codes, rest, suspects)| {
                    residuals_nms[rotor_count..].fill([0.0; 3]);
                    let report = FdiReport {
                        stamp,
                        residuals_nms,
                        wrench_residual,
                        t_test: codes[0],
                        network: codes[1],
                        // Includes codes that only this detector has.
                        sequential: match suspects.3 {
                            0 => -3,
                            1 => 100 * (rotor_count as i32 - 1) + rotor_count as i32,
                            _ => codes[2],
                        },
                        sequential_probability: rest.0,
                        thrust_loss: rest.1,
                        second_thrust_loss: rest.2,
                        suspect_rotors: suspects.0,
                        hypothesis_count: suspects.1,
                        hypothesis_rotors: core::array::from_fn(
                            |i| if (i as u32) < suspects.1 { suspects.2 } else { 0 },
                        ),
                        window_end: rest.3,
                    };
                    (rotor_count, report)
                },
            )
    })
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn sensor_bits(f: &SensorFrame) -> (Stamp, Vec<u32>) {
    let parts = [
        f.position_ned_m,
        f.velocity_ned_m_s,
        f.attitude_rad,
        f.body_rates_rad_s,
        f.reference_position_ned_m,
        f.reference_velocity_ned_m_s,
        [f.reference_yaw_rad, f.battery_voltage_v, 0.0],
    ];
    (f.stamp, bits(parts.as_flattened()))
}

fn command_bits(f: &CommandFrame) -> (Stamp, Vec<u32>, Vec<u32>, u32) {
    (
        f.stamp,
        bits(&f.duty),
        bits(&f.attitude_setpoint_rad),
        f.saturated_rotors,
    )
}

fn report_bits(f: &FdiReport) -> (Stamp, Vec<u32>, Vec<u32>, [i32; 3], [u32; MAX_HYPOTHESES + 3]) {
    let rest = [
        &f.wrench_residual[..],
        &[f.sequential_probability],
        &f.thrust_loss.values(),
        &f.second_thrust_loss.values(),
    ]
    .concat();
    let mut whole = [0; MAX_HYPOTHESES + 3];
    whole[..3].copy_from_slice(&[f.window_end, f.suspect_rotors, f.hypothesis_count]);
    whole[3..].copy_from_slice(&f.hypothesis_rotors);
    (
        f.stamp,
        bits(f.residuals_nms.as_flattened()),
        bits(&rest),
        [f.t_test, f.network, f.sequential],
        whole,
    )
}

fn through_bytes<M: Message + Default>(message: &M) -> M {
    M::decode(message.encode_to_vec().as_slice()).expect("what was encoded can be decoded")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn prop_sensors_come_back_bit_for_bit(frame in sensor_frame()) {
        let frame = frame.canonical();
        let message = through_bytes(&proto::SensorFrame::from(&frame));
        let back = SensorFrame::try_from(&message).expect("finite");
        prop_assert_eq!(sensor_bits(&back), sensor_bits(&frame));
    }

    #[test]
    fn prop_commands_come_back_bit_for_bit((rotor_count, frame) in command_frame()) {
        let frame = frame.canonical();
        let message = through_bytes(&frame.to_proto(rotor_count));
        prop_assert_eq!(message.duty.len(), rotor_count);
        let back = CommandFrame::from_proto(&message, rotor_count).expect("in range");
        prop_assert_eq!(command_bits(&back), command_bits(&frame));
        prop_assert!(CommandFrame::from_proto(&message, rotor_count - 1).is_err());
    }

    #[test]
    fn prop_reports_come_back_bit_for_bit((rotor_count, frame) in fdi_report()) {
        let frame = frame.canonical();
        let message = through_bytes(&frame.to_proto(rotor_count));
        let back = FdiReport::from_proto(&message, rotor_count).expect("in range");
        prop_assert_eq!(report_bits(&back), report_bits(&frame));
        prop_assert!(FdiReport::from_proto(&message, rotor_count - 1).is_err());
    }

    /// The canonical form is the effect of the wire on a frame, and changes only zeros.
    #[test]
    fn prop_canonical_frames_have_no_negative_zero(frame in sensor_frame()) {
        let canonical = frame.canonical();
        prop_assert_eq!(&canonical, &frame, "equal as numbers");
        prop_assert!(!sensor_bits(&canonical).1.contains(&(-0.0_f32).to_bits()));
        prop_assert_eq!(sensor_bits(&canonical.canonical()), sensor_bits(&canonical));
        let sent = SensorFrame::try_from(&through_bytes(&proto::SensorFrame::from(&frame))).expect("finite");
        prop_assert_eq!(sensor_bits(&sent), sensor_bits(&canonical));
    }

    /// Arbitrary bytes are rejected or decoded; nothing panics, and decoded values are in range.
    #[test]
    fn prop_any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..200), rotor_count in rotor_count()) {
        survive(&bytes, rotor_count);
    }

    /// As above, with nearly valid bytes.
    #[test]
    fn prop_damaged_messages_are_survived(
        frame in sensor_frame(),
        (rotor_count, command) in command_frame(),
        (rotors, report) in fdi_report(),
        damage in proptest::collection::vec((any::<usize>(), any::<u8>()), 1..4),
        cut in any::<usize>(),
    ) {
        for mut bytes in [
            proto::SensorFrame::from(&frame).encode_to_vec(),
            command.to_proto(rotor_count).encode_to_vec(),
            report.to_proto(rotors).encode_to_vec(),
        ] {
            for (at, value) in &damage {
                let at = at % bytes.len();
                bytes[at] = *value;
            }
            survive(&bytes, rotor_count);
            survive(&bytes[..cut % bytes.len()], rotors);
        }
    }
}

/// Decodes bytes as every message; accepted frames must satisfy the guarantees of a checked frame.
fn survive(bytes: &[u8], rotor_count: usize) {
    if let Ok(message) = proto::SensorFrame::decode(bytes)
        && let Ok(frame) = SensorFrame::try_from(&message)
    {
        assert!(frame.nav().is_finite() && frame.battery_voltage_v.is_finite());
    }
    if let Ok(message) = proto::MotorCommand::decode(bytes)
        && let Ok(frame) = CommandFrame::from_proto(&message, rotor_count)
    {
        assert!(frame.duty.iter().all(|duty| (0.0..=1.0).contains(duty)));
    }
    if let Ok(message) = proto::FdiReport::decode(bytes)
        && let Ok(frame) = FdiReport::from_proto(&message, rotor_count)
    {
        assert!(frame.residuals_nms.as_flattened().iter().all(|x| x.is_finite()));
        assert!((-2..=rotor_count as i32).contains(&frame.t_test));
    }
    // The handshake has no native form; decoding it must not panic either.
    drop(proto::Join::decode(bytes));
    drop(proto::Setup::decode(bytes));
    drop(proto::Ready::decode(bytes));
    drop(proto::Finish::decode(bytes));
    drop(proto::MeasuredSteps::decode(bytes));
    drop(proto::FdiReports::decode(bytes));
}

/// The error message names message, field, value and what was expected.
#[test]
fn val_refusals_name_the_field() {
    let mut sensors = SensorFrame::default();
    sensors.body_rates_rad_s[1] = f32::NAN;
    let text = check_sensors(&sensors).expect_err("NaN").to_string();
    assert_eq!(text, "SensorFrame.body_rates_rad_s[1] is NaN, expected a finite number");
    sensors.body_rates_rad_s[1] = 0.0;
    sensors.battery_voltage_v = f32::NEG_INFINITY;
    let text = check_sensors(&sensors).expect_err("infinite").to_string();
    assert_eq!(text, "SensorFrame.battery_voltage_v is -inf, expected a finite number");

    let mut command = CommandFrame::default();
    command.duty[5] = 1.0 + f32::EPSILON;
    let text = check_command(&command, 6).expect_err("above 1").to_string();
    assert_eq!(
        text,
        "MotorCommand.duty[5] is 1.0000001192092896, expected a fraction from 0 to 1"
    );
    command.duty[5] = 0.5;
    let text = check_command(&command, 4).expect_err("no rotor 6").to_string();
    assert_eq!(
        text,
        "MotorCommand.duty[5] is 0.5, expected 0, because the vehicle has no such rotor"
    );
    let text = CommandFrame::from_proto(&command.to_proto(6), 8)
        .expect_err("8 rotors")
        .to_string();
    assert_eq!(
        text,
        "MotorCommand.duty has 6 entries, expected one for each of the 8 rotors"
    );

    let report = FdiReport {
        sequential_probability: 1.5,
        ..FdiReport::default()
    };
    let text = check_report(&report, 6).expect_err("above 1").to_string();
    assert_eq!(
        text,
        "FdiReport.sequential_probability is 1.5, expected a fraction from 0 to 1"
    );
    let report = FdiReport {
        network: 7,
        ..FdiReport::default()
    };
    let text = check_report(&report, 6).expect_err("no rotor 7").to_string();
    assert!(text.starts_with("FdiReport.network is 7, expected"), "{text}");

    let message = proto::SensorFrame {
        nav: None,
        ..proto::SensorFrame::from(&SensorFrame::default())
    };
    assert_eq!(
        SensorFrame::try_from(&message).expect_err("no nav").to_string(),
        "SensorFrame.nav is missing"
    );
}

#[test]
fn val_verdicts_that_contradict_themselves_are_refused() {
    let good = FdiReport {
        t_test: 3,
        network: -1,
        sequential: -2,
        ..FdiReport::default()
    }
    .to_proto(6);
    assert_eq!(
        good.t_test,
        Some(proto::Verdict {
            kind: Kind::Faulty.into(),
            rotor: 3,
            second_rotor: 0,
        })
    );
    assert!(FdiReport::from_proto(&good, 6).is_ok());
    for (kind, rotor, second_rotor) in [
        (Kind::Unspecified, 0, 0),
        (Kind::Faulty, 0, 0),
        (Kind::Faulty, 7, 0),
        (Kind::Faulty, 1, 2),
        (Kind::Faulty, u32::MAX, 0),
        (Kind::Healthy, 1, 0),
        (Kind::Healthy, 0, 1),
        (Kind::NotReady, 1, 0),
        (Kind::Unknown, 1, 0),
        (Kind::Ambiguous, 1, 0),
        // Verdicts that only the sequential detector has.
        (Kind::Ambiguous, 0, 0),
        (Kind::FaultyPair, 1, 2),
        // Not a valid pair.
        (Kind::FaultyPair, 2, 1),
        (Kind::FaultyPair, 0, 1),
        (Kind::FaultyPair, u32::MAX, u32::MAX),
    ] {
        let bad = proto::FdiReport {
            t_test: Some(proto::Verdict {
                kind: kind.into(),
                rotor,
                second_rotor,
            }),
            ..good.clone()
        };
        let text = FdiReport::from_proto(&bad, 6).expect_err("a contradiction").to_string();
        assert!(text.starts_with("FdiReport.t_test"), "{text}");
    }
}

/// The encoding itself, by hand from the protobuf specification: field number × 8 + wire type, then the value.
#[test]
fn val_bytes_are_those_of_the_specification() {
    let finish = proto::Finish {
        run_id: 0x0102_0304_0506_0708,
        steps: 300,
        failure: "no".to_owned(),
    };
    let expected = [
        0x09, 0x08, 0x07, 0x06, 0x05, 0x04, 0x03, 0x02, 0x01, // 1: fixed64, least significant byte first
        0x10, 0xac, 0x02, // 2: varint 300
        0x1a, 0x02, b'n', b'o', // 3: string of 2 bytes
    ];
    assert_eq!(finish.encode_to_vec(), expected);
    let command = proto::MotorCommand {
        stamp: Some(proto::Stamp {
            run_id: 0,
            step: 1,
            sim_time_ns: 0,
        }),
        duty: vec![0.5, 1.0],
        attitude_setpoint: None,
        saturated_rotors: 2,
    };
    let expected = [
        0x0a, 0x02, 0x10, 0x01, // 1: message of 2 bytes: 2: varint 1
        0x12, 0x08, 0, 0, 0, 0x3f, 0, 0, 0x80, 0x3f, // 2: packed floats
        0x20, 0x02, // 4: varint 2
    ];
    assert_eq!(command.encode_to_vec(), expected);
}
