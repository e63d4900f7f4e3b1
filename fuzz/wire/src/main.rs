//! Untrusted messages: bytes of any kind through the decoder, the conversions and the hand-shake.
//!
//! The first byte selects the message type of the rest.

#![no_main]

use libfuzzer_sys::fuzz_target;
use prost::Message;
use rotortwin_proto as proto;
use rotortwin_wire::{convert, frames, setup};

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    let rotors = usize::from(which >> 4);
    match which & 15 {
        0 => frame::<proto::SensorFrame, _>(bytes, |m| frames::SensorFrame::try_from(m), |f| f.into()),
        1 => frame::<proto::MotorCommand, _>(
            bytes,
            |m| frames::CommandFrame::from_proto(m, rotors),
            |f| f.to_proto(rotors),
        ),
        2 => frame::<proto::FdiReport, _>(
            bytes,
            |m| frames::FdiReport::from_proto(m, rotors),
            |f| f.to_proto(rotors),
        ),
        3 => with::<proto::ControllerSetup>(bytes, controller),
        4 => with::<proto::FdiSetup>(bytes, fdi),
        5 => with::<proto::Setup>(bytes, |message| match &message.parameters {
            Some(proto::setup::Parameters::Controller(setup)) => controller(setup),
            Some(proto::setup::Parameters::Fdi(setup)) => fdi(setup),
            None => {}
        }),
        6 => with::<proto::Join>(bytes, |_| {}),
        7 => with::<proto::Ready>(bytes, |_| {}),
        8 => with::<proto::Finish>(bytes, |_| {}),
        9 => with::<proto::FdiReports>(bytes, |_| {}),
        10 => with::<proto::MeasuredSteps>(bytes, |_| {}),
        11 => with::<proto::FdiTelemetry>(bytes, |_| {}),
        _ => {}
    }
});

fn controller(setup: &proto::ControllerSetup) {
    drop(setup::controller_config(setup));
}

/// An engine built from the accepted messages.
fn fdi(setup: &proto::FdiSetup) {
    if let Ok(config) = setup::fdi_config(setup) {
        drop(rotortwin_flight_core::fdi::FdiEngine::new(config));
    }
}

/// What was decoded is encoded to something that decodes to the same.
fn with<M: Message + Default>(bytes: &[u8], take: impl FnOnce(&M)) {
    if let Ok(message) = M::decode(bytes) {
        let encoded = message.encode_to_vec();
        let again = M::decode(encoded.as_slice()).expect("what was encoded can be decoded");
        assert!(again.encode_to_vec() == encoded);
        take(&message);
    }
}

/// What was taken for a frame comes back as the same frame.
fn frame<M: Message + Default, F: PartialEq + std::fmt::Debug>(
    bytes: &[u8],
    take: impl Fn(&M) -> Result<F, convert::ConvertError>,
    give: impl Fn(&F) -> M,
) {
    with::<M>(bytes, |message| {
        if let Ok(frame) = take(message) {
            let again = take(&give(&frame)).expect("an accepted frame is accepted again");
            assert_eq!(again, frame);
        }
    });
}
