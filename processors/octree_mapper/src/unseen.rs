//! What becomes of places that were not seen again: moved people and things whose trail nobody has looked through since.

use evac_frames::Voxel;
use evac_octree::OctreeMap;
use evac_stage::check_range;
use serde::{Deserialize, Serialize};

/// Key frames between two looks for places that are too old: each costs a comparison a brick.
const EVERY: u32 = 8;

/// `unseen`: what happens to blocks of 8 x 8 x 8 voxels that no ray has touched for a number of key frames. OctoMap keeps them for
/// ever, and so does the default: a room that was left is still there. People who walk through the view are cleared anyway, by the
/// rays that pass where they were.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UnseenConfig {
    /// Nothing, or which of the two below.
    pub action: UnseenAction,
    /// Key frames without a ray from which a block is too old. 600 are five minutes at rest and 150 m of way.
    pub after_key_frames: u32,
    /// `fade`: how far log-odds move towards zero each eight key frames; at zero a voxel is unknown. 0.2: a wall that is certain
    /// (3.5) is unknown after 144 more key frames. Every voxel that fades is published, so this is for maps of a few rooms.
    pub fade_log_odds: f64,
}

/// See [`UnseenConfig`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UnseenAction {
    /// Everything stays.
    #[default]
    Keep,
    /// What is too old is unknown at once: a map that follows the robot.
    Forget,
    /// What is too old becomes doubtful, and unknown in the end.
    Fade,
}

impl Default for UnseenConfig {
    fn default() -> Self {
        Self { action: UnseenAction::Keep, after_key_frames: 600, fade_log_odds: 0.2 }
    }
}

impl UnseenConfig {
    pub(crate) fn check(&self) -> Result<(), String> {
        if self.after_key_frames == 0 {
            return Err("unseen.after_key_frames = 0 forgets what was just seen; 600 is five minutes, and \
                action = \"keep\" forgets nothing"
                .into());
        }
        check_range("unseen.fade_log_odds", self.fade_log_odds, 0.001, 10.0, "0.2 takes 144 key frames")
    }
}

/// Looks for places that are too old now and then.
#[derive(Debug, Default)]
pub(crate) struct Upkeep {
    pub(crate) key_frames: u32,
    /// What it has changed before the present key frame.
    pub(crate) changed: Vec<Voxel>,
}

impl Upkeep {
    /// Counts a key frame that is about to go into the map.
    pub(crate) fn tend(&mut self, map: &mut OctreeMap, config: &UnseenConfig) {
        self.changed.clear();
        self.key_frames += 1;
        if self.key_frames < EVERY {
            return;
        }
        self.key_frames = 0;
        let changed = &mut self.changed;
        match config.action {
            UnseenAction::Keep => {}
            UnseenAction::Forget => {
                map.forget_unseen_with(config.after_key_frames, |voxel| changed.push(voxel));
            }
            UnseenAction::Fade => {
                let step = config.fade_log_odds as f32;
                map.fade_unseen_with(config.after_key_frames, step, |voxel| changed.push(voxel));
            }
        }
    }
}
