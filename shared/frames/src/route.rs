//! Which instance of a stage is listened to.

use crate::layout::frame;

/// Bits of [`Route::flags`].
pub mod route_flags {
    /// Asks instance `epoch` to stop before its next frame and to say where: it reports itself retired.
    pub const HAND_OVER: u32 = 1;
    /// No older instance lives: what has not come from one will not come.
    pub const ALONE: u32 = 2;
}

frame! {
    /// The launcher's word on `route` about one stage.
    "evac.Route.v1", 88 bytes,
    pub struct Route {
        /// Instance name, UTF-8, zero padded.
        pub stage: [u8; 32],
        /// The data service that the stage writes, UTF-8, zero padded; nothing for a sink.
        pub service: [u8; 32],
        /// Counts the launcher's words about this stage; an older one is no news.
        pub generation: u64,
        /// From this frame on readers listen to `epoch` and before it to older instances.
        pub from_seq: u64,
        /// The instance.
        pub epoch: u32,
        /// See [`route_flags`].
        pub flags: u32,
    }
}
