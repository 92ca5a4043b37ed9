//! What two builds compare before they exchange a frame.

/// One field of a frame: its name, offset, size and Rust type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name in the source.
    pub name: &'static str,
    /// Bytes from the start of the frame.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
    /// The type as it is written in the source.
    pub ty: &'static str,
}

/// A fixed layout with a versioned name, for example `evac.Point.v1`.
pub trait Layout: bytemuck::Pod + std::fmt::Debug {
    /// Versioned name; a changed layout gets a new version.
    const NAME: &'static str;
    /// The fields in memory order.
    const FIELDS: &'static [Field];
}

/// Hash (FNV-1a, 64 bits) over the name, size and every field's name, offset, size and type of `T`.
///
/// The middleware compares only a type's name, size and alignment, so a reordered struct of the same size would be
/// accepted silently; this hash is required as an attribute when a service is opened.
pub const fn layout_hash<T: Layout>() -> u64 {
    let mut hash = fnv(0xcbf2_9ce4_8422_2325, T::NAME.as_bytes());
    hash = fnv(hash, &(size_of::<T>() as u64).to_le_bytes());
    let mut i = 0;
    while i < T::FIELDS.len() {
        let field = T::FIELDS[i];
        hash = fnv(hash, field.name.as_bytes());
        hash = fnv(hash, &(field.offset as u64).to_le_bytes());
        hash = fnv(hash, &(field.size as u64).to_le_bytes());
        hash = fnv(hash, field.ty.as_bytes());
        i += 1;
    }
    hash
}

const fn fnv(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}

/// Declares a frame: a `#[repr(C)]` Pod struct, its [`Layout`] and a compile-time check of its size.
macro_rules! frame {
    (
        $(#[$meta:meta])*
        $layout:literal, $bytes:literal bytes,
        pub struct $name:ident { $( $(#[$field_meta:meta])* pub $field:ident : $ty:ty, )* }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $( $(#[$field_meta])* pub $field: $ty, )* }

        impl $crate::layout::Layout for $name {
            const NAME: &'static str = $layout;
            const FIELDS: &'static [$crate::layout::Field] = &[$( $crate::layout::Field {
                name: stringify!($field),
                offset: core::mem::offset_of!($name, $field),
                size: size_of::<$ty>(),
                ty: stringify!($ty),
            }, )*];
        }

        const _: () = assert!(size_of::<$name>() == $bytes);

        impl Default for $name {
            fn default() -> Self { <Self as bytemuck::Zeroable>::zeroed() }
        }
    };
}
pub(crate) use frame;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImuSample, Point, PoseFrame, ScanHeader, Voxel};

    frame! {
        #[allow(unreachable_pub)]
        "evac.Point.v1", 16 bytes, pub struct Reordered { pub y: f32, pub x: f32, pub z: f32, pub packed: u32, }
    }

    #[test]
    fn a_reordered_struct_of_the_same_name_and_size_has_another_hash() {
        assert_eq!(Reordered::NAME, Point::NAME);
        assert_ne!(layout_hash::<Reordered>(), layout_hash::<Point>());
    }

    #[test]
    fn layouts_do_not_collide() {
        let hashes = [
            layout_hash::<Point>(),
            layout_hash::<ImuSample>(),
            layout_hash::<PoseFrame>(),
            layout_hash::<ScanHeader>(),
            layout_hash::<Voxel>(),
        ];
        for (i, a) in hashes.iter().enumerate() {
            assert!(hashes.iter().skip(i + 1).all(|b| a != b));
        }
    }
}
