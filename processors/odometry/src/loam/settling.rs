//! Scan-to-scan tracking until the velocity is known well enough to lay a map: after a start in motion and after a loss
//! from which there was no way back.

/// Frames of it.
const FRAMES: u32 = 10;
/// The map of these frames is smeared by a velocity that was not known; it is used for so many only.
const REFRESH: u32 = 5;

/// How far the settling is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settling {
    frames_left: u32,
    /// The map frame is not yet fixed: it will be where the LiDAR is at the end.
    pub(crate) starting: bool,
}

/// What to do with the map that is only used meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scratch {
    /// Add the scan.
    Extend,
    /// Clear it and add the scan.
    Renew,
    /// As above, and the settling is over.
    Done,
}

impl Settling {
    pub(crate) fn at_start() -> Self {
        Self { frames_left: FRAMES, starting: true }
    }

    pub(crate) fn after_loss() -> Self {
        Self { frames_left: FRAMES, starting: false }
    }

    /// Counts a frame.
    pub(crate) fn step(&mut self) -> Scratch {
        self.frames_left = self.frames_left.saturating_sub(1);
        match self.frames_left {
            0 => Scratch::Done,
            left if left % REFRESH == 0 => Scratch::Renew,
            _ => Scratch::Extend,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scratch_map_is_renewed_once_and_ends_with_the_settling() {
        let mut settling = Settling::at_start();
        let steps: Vec<_> = (0..FRAMES).map(|_| settling.step()).collect();
        assert_eq!(steps.iter().filter(|step| **step == Scratch::Renew).count(), 1);
        assert_eq!(steps.last(), Some(&Scratch::Done));
    }
}
