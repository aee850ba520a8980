//! How much a scene is trained: named amounts that replace what the scene says.

use hair_bench::training_motions::train_little;
use io_formats::scene::{Scene, TrainSpec};

/// An amount of training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Preset {
    /// Eight seconds of random head motion in four sequences, hairs rubbing on each other, 25 frames a second; one second of
    /// validation, one held out.
    Full,
    /// As little as still gives a usable model: two short sequences, no rubbing, at most six eligible guides, nothing held
    /// out. For benchmarks of the runtime.
    Bench,
}

impl Preset {
    /// Replaces the scene's amounts; its seed, recorded motions and parameters of learning stay.
    pub fn apply(self, scene: &mut Scene) {
        match self {
            Self::Full => {
                scene.train = TrainSpec {
                    sequences: 4,
                    seconds_per_sequence: 2.0,
                    fps: 25.0,
                    friction: true,
                    validation_seconds: 1.0,
                    held_out_seconds: 1.0,
                    ..scene.train.clone()
                };
            }
            Self::Bench => train_little(scene),
        }
    }
}
