//! Messages generated from `proto/rotortwin/v1` and `proto/foxglove` (`cargo xtask codegen`); documented in the `.proto` files.
//!
//! Nothing is written by hand here: conversions and checks are in `rotortwin-wire`.
#![expect(missing_docs, reason = "generated; the .proto files carry the documentation")]

include!("rotortwin.v1.rs");

/// Serialized `FileDescriptorSet` of the package, for files that describe themselves (MCAP).
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("descriptor.bin");

/// Messages that Foxglove and Lichtblick draw by themselves.
pub mod foxglove {
    include!("foxglove.rs");

    /// Serialized `FileDescriptorSet` of these messages.
    pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("foxglove.bin");
}

/// What Foxglove's messages take from Google: moments and durations.
pub mod google {
    /// The package.
    pub mod protobuf {
        include!("google.protobuf.rs");
    }
}
