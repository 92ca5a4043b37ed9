//! Memory for bricks in runs of 64-byte units.

/// 512 bits: a plane of a brick.
pub(crate) type Unit = [u64; 8];

/// Units that are allocated together: 4 KiB, and as many as a word has bits.
const PAGE: usize = 64;

/// Longest run.
pub(crate) const MAX_RUN: usize = 32;

/// Runs of units by the index of their first; they never cross pages. A freed run joins its free
/// neighbours, so that bricks whose size changes with time leave little unused.
#[derive(Clone, Debug)]
pub(crate) struct Units {
    pages: Vec<Box<[Unit; PAGE]>>,
    /// By page: its free units.
    free: Vec<u64>,
    /// By page: length of the longest free run, at most [`MAX_RUN`].
    longest: Vec<u8>,
    /// By length: no page before this one has so long a free run.
    first: [u32; MAX_RUN + 1],
    used: usize,
}

impl Default for Units {
    fn default() -> Self {
        Self { pages: Vec::new(), free: Vec::new(), longest: Vec::new(), first: [0; MAX_RUN + 1], used: 0 }
    }
}

impl Units {
    /// A run of `length` units (1 to [`MAX_RUN`]) of any content.
    pub(crate) fn add(&mut self, length: usize) -> u32 {
        let from = (self.first[length] as usize).min(self.pages.len());
        let found = self.longest[from..].iter().position(|&longest| usize::from(longest) >= length);
        let page = from + found.unwrap_or(self.pages.len() - from);
        if page == self.pages.len() {
            self.grow();
        }
        self.first[length] = page as u32;
        self.take(page, length)
    }

    /// Some more pages, in proportion to what is there, so that a use that goes up and down seldom needs any.
    #[cold]
    fn grow(&mut self) {
        let more = 1 + self.pages.len() / 16;
        self.pages.reserve_exact(more);
        for _ in 0..more {
            self.pages.push(Box::new([[0; 8]; PAGE]));
            self.free.push(u64::MAX);
            self.longest.push(MAX_RUN as u8);
        }
    }

    fn take(&mut self, page: usize, length: usize) -> u32 {
        let start = starts(self.free[page], length).trailing_zeros();
        self.set_free(page, self.free[page] & !(ones(length) << start));
        self.used += length;
        (page * PAGE) as u32 + start
    }

    /// Gives a run back.
    pub(crate) fn remove(&mut self, at: u32, length: usize) {
        let page = at as usize / PAGE;
        self.set_free(page, self.free[page] | ones(length) << (at as usize % PAGE));
        self.used -= length;
        for first in &mut self.first[..=usize::from(self.longest[page])] {
            *first = (*first).min(page as u32);
        }
    }

    /// Whether so much is free that it is worth moving runs together; then the index from which on pages should
    /// become empty.
    pub(crate) fn excess(&self) -> Option<u32> {
        let needed = self.used + self.used / 16;
        let held = self.pages.len() * PAGE;
        (held > needed + self.used / 16 + 3 * PAGE).then(|| ((needed.div_ceil(PAGE) + 2) * PAGE) as u32)
    }

    /// Moves a run to a place before `end`, if there is one.
    pub(crate) fn move_before(&mut self, at: u32, length: usize, end: u32) -> Option<u32> {
        let pages = end as usize / PAGE;
        let from = self.first[length] as usize;
        let before = self.longest.get(from..pages.min(self.longest.len()))?;
        let page = from + before.iter().position(|&longest| usize::from(longest) >= length)?;
        let new = self.take(page, length);
        for unit in 0..length {
            let content = self.run(at, length)[unit];
            self.run_mut(new, length)[unit] = content;
        }
        self.remove(at, length);
        Some(new)
    }

    /// Gives empty pages from `end` on back to the system.
    pub(crate) fn shrink(&mut self, end: u32) {
        while self.pages.len() > end as usize / PAGE && self.free.last() == Some(&u64::MAX) {
            self.pages.pop();
            self.free.pop();
            self.longest.pop();
        }
    }

    fn set_free(&mut self, page: usize, free: u64) {
        self.free[page] = free;
        // By halving: each power of two fits or not.
        let mut longest = 0;
        for step in [32, 16, 8, 4, 2, 1] {
            if longest + step <= MAX_RUN && starts(free, longest + step) != 0 {
                longest += step;
            }
        }
        self.longest[page] = longest as u8;
    }

    #[inline]
    pub(crate) fn run(&self, at: u32, length: usize) -> &[Unit] {
        let first = at as usize % PAGE;
        &self.pages[at as usize / PAGE][first..first + length]
    }

    #[inline]
    pub(crate) fn run_mut(&mut self, at: u32, length: usize) -> &mut [Unit] {
        let first = at as usize % PAGE;
        &mut self.pages[at as usize / PAGE][first..first + length]
    }

    /// Bytes of free units, which new bricks will use.
    pub(crate) fn free_bytes(&self) -> usize {
        (self.pages.len() * PAGE - self.used) * size_of::<Unit>()
    }

    /// Bytes held, free units included.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.pages.len() * size_of::<[Unit; PAGE]>()
            + self.pages.capacity() * size_of::<Box<[Unit; PAGE]>>()
            + self.free.capacity() * 8
            + self.longest.capacity()
    }
}

/// So many low bits.
fn ones(length: usize) -> u64 {
    (1 << length) - 1
}

/// The bits from which on so many are set.
fn starts(mut bits: u64, length: usize) -> u64 {
    let mut have = 1;
    while have < length {
        let step = have.min(length - have);
        bits &= bits >> step;
        have += step;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_do_not_overlap_and_freed_ones_are_used_again() {
        let mut units = Units::default();
        let mut runs = Vec::new();
        for n in 0..400_usize {
            let length = 1 + n * 7 % MAX_RUN;
            let at = units.add(length);
            units.run_mut(at, length).fill([n as u64; 8]);
            runs.push((at, length, n as u64));
            if n % 3 == 2 {
                let (at, length, _) = runs.swap_remove(n / 3);
                units.remove(at, length);
            }
        }
        for &(at, length, n) in &runs {
            assert!(units.run(at, length).iter().all(|unit| *unit == [n; 8]));
        }
        let held = units.memory_bytes();
        runs.iter().for_each(|&(at, length, _)| units.remove(at, length));
        runs.iter().for_each(|&(_, length, _)| {
            units.add(length);
        });
        assert!(units.memory_bytes() < held + held / 4, "{held} {}", units.memory_bytes());
        assert!(units.free_bytes() < held / 4);
    }
}
