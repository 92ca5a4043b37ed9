//! Frames as the middleware sees them.

use bytemuck::{Pod, TransparentWrapper, Zeroable};
use evac_frames::Layout;
use iceoryx2::prelude::ZeroCopySend;

/// A frame in shared memory, known to the middleware by its versioned layout name.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Wire<T>(pub(crate) T);

// SAFETY: `Wire<T>` is `repr(transparent)` over `T`.
#[allow(unsafe_code)]
unsafe impl<T> TransparentWrapper<T> for Wire<T> {}

// SAFETY: transparent over a Pod type.
#[allow(unsafe_code)]
unsafe impl<T: Zeroable> Zeroable for Wire<T> {}
// SAFETY: transparent over a Pod type.
#[allow(unsafe_code)]
unsafe impl<T: Pod> Pod for Wire<T> {}

// SAFETY: `Layout` requires Pod: self-contained, without pointers, padding or invalid bit patterns; all frames are
// `repr(C)`. The name is the layout's versioned name, and `layout_hash` guards against two layouts of one name.
#[allow(unsafe_code)]
unsafe impl<T: Layout> ZeroCopySend for Wire<T> {
    unsafe fn type_name() -> &'static str {
        T::NAME
    }
}

impl<T: Layout> Default for Wire<T> {
    fn default() -> Self {
        Self(T::zeroed())
    }
}
