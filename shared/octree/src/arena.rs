//! Room for many blocks of equal size, reused when freed.

/// Blocks that are allocated together: enough that the allocator is seldom asked, few enough that little is unused.
const CHUNK: usize = 32;

/// Blocks by index; they never move.
#[derive(Clone, Debug)]
pub(crate) struct Arena<T> {
    chunks: Vec<Box<[T]>>,
    used: u32,
    free: Vec<u32>,
}

impl<T> Default for Arena<T> {
    fn default() -> Self {
        Self { chunks: Vec::new(), used: 0, free: Vec::new() }
    }
}

impl<T: Copy> Arena<T> {
    /// Index of a block with this content.
    pub(crate) fn add(&mut self, content: T) -> u32 {
        if let Some(index) = self.free.pop() {
            *self.get_mut(index) = content;
            return index;
        }
        let index = self.used;
        self.used += 1;
        if index as usize == self.chunks.len() * CHUNK {
            self.chunks.push(vec![content; CHUNK].into_boxed_slice());
            // Freeing a block never allocates then.
            self.free.reserve(self.chunks.len() * CHUNK);
        } else {
            *self.get_mut(index) = content;
        }
        index
    }

    /// Gives a block back.
    pub(crate) fn remove(&mut self, index: u32) {
        self.free.push(index);
    }

    #[inline]
    pub(crate) fn get(&self, index: u32) -> &T {
        &self.chunks[index as usize / CHUNK][index as usize % CHUNK]
    }

    #[inline]
    pub(crate) fn get_mut(&mut self, index: u32) -> &mut T {
        &mut self.chunks[index as usize / CHUNK][index as usize % CHUNK]
    }

    /// Bytes held, free blocks included.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.chunks.len() * CHUNK * size_of::<T>()
            + self.chunks.capacity() * size_of::<Box<[T]>>()
            + self.free.capacity() * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_keep_their_content_and_freed_ones_are_used_again() {
        let mut arena = Arena::default();
        let indices: Vec<_> = (0..100_u64).map(|n| arena.add(n)).collect();
        arena.remove(indices[7]);
        let held = arena.memory_bytes();
        assert_eq!(arena.add(1000), indices[7]);
        assert_eq!(arena.memory_bytes(), held);
        assert_eq!((*arena.get(indices[6]), *arena.get(indices[7]), *arena.get(indices[99])), (6, 1000, 99));
    }
}
