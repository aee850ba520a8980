//! The head motions a model is trained, validated and held to account on: random ones (NI20 §5.2) and recorded ones.
//!
//! Invariant: motions of different use never mix. Random ones come from different streams of the seed whatever their
//! number; a stretch of a recording that serves two uses is refused.

use crate::error::Error;
use crate::head_motion::{HeadMotionParams, random_head_motion};
use io_formats::motion::PoseMotion;
use io_formats::scene::{MotionSpec, MotionUse, RecordedSpec, Scene, TrainSpec};
use std::path::Path;

/// A head motion that frames are recorded of.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingMotion {
    /// What its frames are for.
    pub used_for: MotionUse,
    /// Poses of the head, from the identity.
    pub motion: PoseMotion,
    /// How much of it, s.
    pub seconds: f64,
    /// In words, for reports.
    pub name: String,
}

/// Where the random sequences of a use begin in the stream of sequences: no count of one reaches the next.
fn first_sequence(used_for: MotionUse) -> u64 {
    match used_for {
        MotionUse::Train => 0,
        MotionUse::Validation => 1 << 32,
        MotionUse::HeldOut => 2 << 32,
    }
}

/// All motions of a scene's training: those to train on first, then validation, then held out.
///
/// # Errors
/// A recording that cannot be read, is shorter than asked, or serves two uses.
pub fn training_motions(scene: &Scene) -> Result<Vec<TrainingMotion>, Error> {
    let spec = &scene.train;
    check_uses(&spec.recorded)?;
    let mut motions = Vec::new();
    for (used_for, n_random, seconds, name) in [
        (MotionUse::Train, spec.sequences, spec.seconds_per_sequence, "random"),
        (MotionUse::Validation, usize::from(spec.validation_seconds > 0.0), spec.validation_seconds, "validation"),
        (MotionUse::HeldOut, usize::from(spec.held_out_seconds > 0.0), spec.held_out_seconds, "held out"),
    ] {
        for k in 0..n_random {
            let sequence = first_sequence(used_for) + k as u64;
            let motion = random_head_motion(spec.seed, sequence, seconds, &HeadMotionParams::lively());
            motions.push(TrainingMotion { used_for, motion, seconds, name: format!("{name} {}", k + 1) });
        }
        for recorded in spec.recorded.iter().filter(|r| r.used_for == used_for) {
            motions.push(load(recorded, scene.head.pivot_cm)?);
        }
    }
    Ok(motions)
}

/// Trains a scene as little as still gives a usable model: two short sequences, no rubbing, at most six eligible guides, nothing
/// held out. For benchmarks of the runtime.
pub fn train_little(scene: &mut Scene) {
    scene.train = TrainSpec {
        sequences: 2,
        seconds_per_sequence: 0.5,
        fps: 25.0,
        friction: false,
        validation_seconds: 0.0,
        held_out_seconds: 0.0,
        ..scene.train.clone()
    };
    scene.groom.max_eligible = scene.groom.max_eligible.min(6);
}

/// The random motion that a scene's model is held to account on, of any length.
#[must_use]
pub fn held_out_motion(scene: &Scene, seconds: f64) -> PoseMotion {
    random_head_motion(scene.train.seed, first_sequence(MotionUse::HeldOut), seconds, &HeadMotionParams::lively())
}

fn load(recorded: &RecordedSpec, pivot_cm: [f64; 3]) -> Result<TrainingMotion, Error> {
    let RecordedSpec { motion: spec, seconds, used_for } = recorded;
    let motion = spec.load(*seconds, pivot_cm)?;
    let name = match spec {
        MotionSpec::Bvh { path, joint, .. } => {
            format!("{joint} of {}", path.file_name().unwrap_or(path.as_os_str()).to_string_lossy())
        }
        MotionSpec::Still | MotionSpec::Keys(_) => "keys".to_owned(),
    };
    let length = motion.keys.last().map_or(0.0, |key| key.time_s);
    // A recording samples instants: the last one stands for as long as the time between two.
    let between = motion.keys.get(1).map_or(0.0, |key| key.time_s);
    // Frame times are written with few digits: half of one is no difference.
    if length + 1.5 * between < *seconds {
        return Err(Error::ShortMotion { name, seconds: *seconds, length });
    }
    Ok(TrainingMotion { used_for: *used_for, motion, seconds: *seconds, name })
}

/// Where a recording is used: file, and the frames from the first to past the last. Whatever the joint: those of one body
/// move together.
fn stretch(recorded: &RecordedSpec) -> Result<Option<(&Path, usize, usize)>, Error> {
    let MotionSpec::Bvh { path, skip_frames, .. } = &recorded.motion else { return Ok(None) };
    let frames = recorded.seconds / io_formats::Bvh::read(path)?.frame_time();
    Ok(Some((path, *skip_frames, skip_frames.saturating_add(frames.round() as usize))))
}

fn check_uses(all: &[RecordedSpec]) -> Result<(), Error> {
    for (k, a) in all.iter().enumerate() {
        for b in all[..k].iter().filter(|b| b.used_for != a.used_for) {
            let (Some((path, from, to)), Some((other, other_from, other_to))) = (stretch(a)?, stretch(b)?) else {
                continue;
            };
            if from < other_to && other_from < to && same_bytes(path, other) {
                let (path, first, last) = (path.to_path_buf(), from.max(other_from), to.min(other_to) - 1);
                return Err(Error::MixedMotion { path, first, last });
            }
        }
    }
    Ok(())
}

/// Whether two paths lead to equal files; a copy is the same recording.
fn same_bytes(a: &Path, b: &Path) -> bool {
    a == b || matches!((std::fs::read(a), std::fs::read(b)), (Ok(x), Ok(y)) if x == y)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BVH: &str = "HIERARCHY\nROOT Head\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n End Site\n {\n  OFFSET 0 1 0\n }\n}\nMOTION\nFrames: 40\nFrame Time: 0.0499999\n";

    fn with_recording(directory: &Path, train: &str) -> Result<Vec<TrainingMotion>, Error> {
        let mut text = BVH.to_owned();
        for f in 0..40 {
            text += &format!("0 0 0 {} 0 0\n", f);
        }
        for name in ["a.bvh", "copy.bvh"] {
            std::fs::write(directory.join(name), &text).unwrap();
        }
        let scene = format!(
            "name = \"x\"\n[groom]\ngenerator = {{ style = \"straight\", strands = 200, length_cm = 5, seed = 1 }}\n{train}"
        );
        training_motions(&Scene::from_toml(&scene, directory)?)
    }

    fn recorded(file: &str, skip: usize, seconds: f64, used_for: &str) -> String {
        format!(
            "[[train.recorded]]\nbvh = \"{file}\"\njoint = \"Head\"\nunit = \"cm\"\nskip_frames = {skip}\nseconds = {seconds}\nused_for = \"{used_for}\"\n"
        )
    }

    #[test]
    fn motions_of_different_use_never_mix() {
        let directory = tempfile::tempdir().unwrap();
        for (file, skip, mixed) in [("a.bvh", 10, true), ("a.bvh", 20, false), ("copy.bvh", 19, true)] {
            let specs = recorded("a.bvh", 0, 1.0, "train") + &recorded(file, skip, 0.9, "held-out");
            let result = with_recording(directory.path(), &specs);
            assert_eq!(matches!(result, Err(Error::MixedMotion { .. })), mixed, "{file} from frame {skip}: {result:?}");
        }
        let more = "[train]\nsequences = 3\nvalidation_seconds = 4\nheld_out_seconds = 4\nseconds_per_sequence = 4\n";
        let random = with_recording(directory.path(), more).unwrap();
        assert_eq!(random.len(), 5);
        for (k, a) in random.iter().enumerate() {
            assert!(random[..k].iter().all(|b| a.motion != b.motion), "{}", a.name);
        }
    }

    #[test]
    fn what_is_held_out_does_not_depend_on_how_much_is_trained_on() {
        let directory = tempfile::tempdir().unwrap();
        let held_out = |n: usize| {
            let motions = with_recording(directory.path(), &format!("[train]\nsequences = {n}\n")).unwrap();
            motions.into_iter().find(|m| m.used_for == MotionUse::HeldOut).expect("the default holds one out")
        };
        assert_eq!(held_out(1), held_out(5));
    }

    #[test]
    fn a_recording_shorter_than_asked_is_refused_with_its_length() {
        let directory = tempfile::tempdir().unwrap();
        let long = with_recording(directory.path(), &recorded("a.bvh", 1, 2.1, "train"));
        assert!(long.unwrap_err().to_string().contains("1.9"), "thirty-nine frames of a twentieth");
        let whole = with_recording(directory.path(), &recorded("a.bvh", 0, 2.0, "train")).unwrap();
        assert_eq!(whole.iter().filter(|m| m.used_for == MotionUse::Train).count(), 7);
    }
}
