//! Scene files: everything one run needs, in documented TOML (docs/SCENE.md has a complete example).
//!
//! Unknown fields are refused, so that a misspelt name is an error and not a default. Every number is checked when the file
//! is read; errors name the field. Relative paths are taken from the scene file's folder. Lengths are centimetres, times
//! seconds and angles degrees, as the field names say; files state their own unit, since nothing is guessed.

mod check;
mod raw;

use std::path::{Path, PathBuf};

use nalgebra::{UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::bvh::Bvh;
use crate::error::{Error, Result};
use crate::groom::{Groom, LengthUnit, negate_axes, read_groom};
use crate::mesh::{TriMesh, read_mesh};
use crate::motion::{MotionEnd, PoseKey, PoseMotion};
use crate::skinning_model::MaterialRecord;

/// A validated scene.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name for reports and output files; required.
    pub name: String,
    /// Simulated time in seconds; default 4.
    #[serde(default = "raw::seconds")]
    pub seconds: f64,
    /// Time step in seconds; default 0.01.
    #[serde(default = "raw::step_s")]
    pub step_s: f64,
    /// Pictures and cache frames per second; default 24.
    #[serde(default = "raw::fps")]
    pub fps: f64,
    /// The hair; required.
    pub groom: GroomSpec,
    /// The head; default the built-in head, at rest.
    #[serde(default)]
    pub head: HeadSpec,
    /// Everything else the hair must not enter; default none.
    #[serde(default, rename = "solid")]
    pub solids: Vec<SolidSpec>,
    /// What the hair is made of; default the straight preset.
    #[serde(default)]
    pub material: MaterialSpec,
    /// How the skinning model is trained.
    #[serde(default)]
    pub train: TrainSpec,
    /// From where pictures are taken.
    #[serde(default)]
    pub camera: CameraSpec,
}

/// The hair and how many particles and guides it gets.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "raw::RawGroom")]
pub struct GroomSpec {
    /// File or generator.
    pub source: GroomSource,
    /// Particles per strand after resampling; default 25.
    pub particles: usize,
    /// Simulated guide hairs; default 100.
    pub guides: usize,
    /// Most guides one hair may follow, 1 to 9; default 9.
    pub max_eligible: usize,
    /// Remove strands without length instead of refusing the groom; default false.
    pub drop_degenerate: bool,
    /// Strands that a groom file is densified or thinned to; default as many as it has.
    pub densify_to: Option<usize>,
}

/// Where strands come from.
#[derive(Debug, Clone, PartialEq)]
pub enum GroomSource {
    /// A groom file, see [`read_groom`].
    File {
        /// The file.
        path: PathBuf,
        /// Its length unit; required.
        unit: LengthUnit,
        /// Axes x, y, z to negate; default none.
        negate: [bool; 3],
        /// Added to every point after scaling and negating (cm); default zero.
        translate_cm: [f64; 3],
    },
    /// A groom made by the program.
    Generated(GeneratorSpec),
}

/// A groom made by the program on the built-in head.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeneratorSpec {
    /// Shape of the strands; required.
    pub style: HairStyle,
    /// Number of strands; required.
    pub strands: usize,
    /// Strand length in cm; default 25.
    #[serde(default = "raw::length_cm")]
    pub length_cm: f64,
    /// Seed of root positions and variation; default 1.
    #[serde(default = "raw::seed")]
    pub seed: u64,
}

/// A style of hair: shape of generated strands, or material preset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HairStyle {
    /// Straight.
    Straight,
    /// Wavy.
    Wavy,
    /// Curly.
    Curly,
}

/// The head: its surface and how it moves.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(try_from = "raw::RawHead")]
pub struct HeadSpec {
    /// Surface; default the built-in head.
    pub shape: HeadShape,
    /// Motion; default none.
    pub motion: MotionSpec,
    /// Point the head turns about (cm, head frame); default the origin.
    pub pivot_cm: [f64; 3],
}

/// The head's surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum HeadShape {
    /// The analytic head that generated grooms grow on.
    #[default]
    Builtin,
    /// A ball about the origin, with hair all over; radius in cm.
    Ball(f64),
    /// A mesh in the groom's frame.
    Mesh(MeshSource),
}

/// A mesh file and how it is placed in its solid's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSource {
    /// A `.obj` or `.stl` file.
    pub path: PathBuf,
    /// Its length unit; required.
    pub unit: LengthUnit,
    /// Move the middle of the bounding box to the origin first; default false.
    pub center: bool,
    /// Then rotate about x, y and z in this order (degrees); default zero.
    pub rotate_deg: [f64; 3],
}

/// Something hair must not enter.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "raw::RawSolid")]
pub struct SolidSpec {
    /// Name in reports and caches, unique; required.
    pub name: String,
    /// Mesh or analytic shape; required.
    pub shape: SolidShape,
    /// Coulomb friction with hair; default 0.3.
    pub friction: f64,
    /// What its poses are relative to; default the world.
    pub attach: Attach,
    /// Motion; default none, at the origin.
    pub motion: MotionSpec,
}

/// The frame a solid's poses are relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Attach {
    /// The world.
    #[default]
    World,
    /// The moving head.
    Head,
}

/// The shape of a solid.
#[derive(Debug, Clone, PartialEq)]
pub enum SolidShape {
    /// A mesh.
    Mesh(MeshSource),
    /// A sphere about the origin.
    Sphere {
        /// Radius (cm).
        radius_cm: f64,
    },
    /// A capsule about the origin along the solid's y axis.
    Rod {
        /// Radius (cm).
        radius_cm: f64,
        /// Length between the centres of its two caps (cm).
        length_cm: f64,
    },
    /// A row of round teeth on a round spine: spine along x, centred at the origin, teeth along -z.
    Comb {
        /// Number of teeth.
        teeth: usize,
        /// Distance between the axes of neighbouring teeth (cm).
        pitch_cm: f64,
        /// Radius of a tooth (cm).
        tooth_radius_cm: f64,
        /// Length of a tooth from the spine's axis (cm).
        tooth_length_cm: f64,
        /// Radius of the spine (cm).
        spine_radius_cm: f64,
    },
    /// A toothed ring on spokes about the solid's z axis, cut through between them.
    Gear {
        /// Number of teeth.
        teeth: usize,
        /// Number of spokes.
        spokes: usize,
        /// Radius at the tips of the teeth (cm).
        radius_cm: f64,
        /// Height of a tooth (cm).
        tooth_cm: f64,
        /// Radius of the bore (cm).
        bore_cm: f64,
        /// Thickness along z (cm).
        width_cm: f64,
    },
}

/// How a head or solid moves.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum MotionSpec {
    /// Not at all.
    #[default]
    Still,
    /// Key poses; held before the first and after the last.
    Keys(Vec<KeySpec>),
    /// A joint of a BVH file, relative to its first used frame.
    Bvh {
        /// The file.
        path: PathBuf,
        /// The joint's name; required.
        joint: String,
        /// Length unit of the file; required.
        unit: LengthUnit,
        /// Frames left out at the start, e.g. 1 for an added T-pose; default 0.
        skip_frames: usize,
        /// Turn of the file's world about y (degrees), so that the actor faces where the head does; default 0.
        yaw_deg: f64,
        /// Play backwards and forwards until the scene ends, instead of holding the last pose; default false.
        repeat: bool,
    },
}

/// One key pose.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeySpec {
    /// Time in seconds; required, ascending.
    pub t: f64,
    /// Translation (cm); default zero.
    #[serde(default)]
    pub translate_cm: [f64; 3],
    /// Rotation about x, then y, then z, each by this many degrees about fixed axes; default zero.
    #[serde(default)]
    pub rotate_deg: [f64; 3],
}

/// A preset and what replaces its constants. The presets themselves belong to the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// Preset; default straight.
    #[serde(default = "raw::preset")]
    pub preset: HairStyle,
    /// Stretch spring constant, dyn; default the preset's, as all below.
    pub stretch_dyn: Option<f64>,
    /// Bend spring constant, dyn.
    pub bend: Option<f64>,
    /// Torsion and altitude spring constant, dyn.
    pub twist: Option<f64>,
    /// Damping of stretch springs.
    pub stretch_damping: Option<f64>,
    /// Damping of bend springs.
    pub bend_damping: Option<f64>,
    /// Damping of torsion and altitude springs.
    pub twist_damping: Option<f64>,
    /// Coulomb friction of hair.
    pub friction: Option<f64>,
    /// Mass per length, g/cm.
    pub linear_density_g_per_cm: Option<f64>,
    /// Drag of air on velocity, 1/s.
    pub air_drag_per_s: Option<f64>,
}

/// What a recorded sequence of frames is for. Motions of different use never mix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionUse {
    /// Guides and weights are learned from it.
    Train,
    /// Choices such as the number of guides are judged on it.
    Validation,
    /// The error that is reported is measured on it.
    HeldOut,
}

/// A recorded head motion to train with.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "raw::RawRecorded")]
pub struct RecordedSpec {
    /// The motion: of a BVH joint, relative to its first used frame.
    pub motion: MotionSpec,
    /// How much of it is used (s).
    pub seconds: f64,
    /// What for; default training.
    pub used_for: MotionUse,
}

/// How the skinning model is trained.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSpec {
    /// Random head-motion sequences; default 6. May be 0 where recorded motions are trained with.
    pub sequences: usize,
    /// Length of each in seconds; default 4.
    pub seconds_per_sequence: f64,
    /// Frames recorded per second; default 25.
    pub fps: f64,
    /// Seed of the head motions; default 7.
    pub seed: u64,
    /// beta of AS16 Eq. (9) with signals scaled to a mean squared length of one; default 0.015, which fits better than the
    /// 0.15 that AS16 uses on signals of a scale it does not state.
    pub sparsity: f64,
    /// epsilon of AS16 Algorithm 2: guides of less weight make a set superfluous; default 0.01.
    pub min_weight: f64,
    /// Whether hairs rub on each other wherever all of them are simulated: in recorded frames and in what runs are compared
    /// with (AS16 §7.1); default false, since a step then takes two to four times as long.
    pub friction: bool,
    /// Seconds of one further random sequence that the number of guides is judged on; default 0, none.
    pub validation_seconds: f64,
    /// Seconds of one further random sequence, kept out of training, that `train` measures the model's error on; default 4.
    pub held_out_seconds: f64,
    /// Recorded head motions, beside the random ones; default none.
    pub recorded: Vec<RecordedSpec>,
}

/// A pinhole camera looking from `eye_cm` at `target_cm`, y up.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSpec {
    /// Eye (cm, world); default (0, 5, 80).
    pub eye_cm: [f64; 3],
    /// Point in the middle of the picture (cm, world); default (0, -4, 0).
    pub target_cm: [f64; 3],
    /// Vertical field of view (degrees); default 35.
    pub vertical_fov_deg: f64,
    /// Width of the picture in pixels; default 768.
    pub width: u32,
    /// Height of the picture in pixels; default 768.
    pub height: u32,
}

impl Scene {
    /// Reads and validates a scene file.
    ///
    /// # Errors
    /// When the file cannot be read, is not valid TOML, or a field is unknown, missing or makes no sense.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
        Self::parse(&text, path, path.parent().unwrap_or(Path::new("")))
    }

    /// A scene from TOML text; relative paths are taken from `base_dir`.
    ///
    /// # Errors
    /// As [`Scene::read`].
    pub fn from_toml(text: &str, base_dir: &Path) -> Result<Self> {
        Self::parse(text, Path::new("scene"), base_dir)
    }

    fn parse(text: &str, path: &Path, base_dir: &Path) -> Result<Self> {
        let mut scene: Self =
            toml::from_str(text).map_err(|e| Error::SceneSyntax { path: path.to_path_buf(), source: Box::new(e) })?;
        check::check(&scene).map_err(|(field, reason)| Error::SceneField {
            path: path.to_path_buf(),
            field,
            reason,
        })?;
        scene.resolve(base_dir);
        Ok(scene)
    }

    fn resolve(&mut self, base_dir: &Path) {
        // Joining leaves absolute paths as they are.
        let absolute = |path: &mut PathBuf| *path = base_dir.join(&*path);
        if let GroomSource::File { path, .. } = &mut self.groom.source {
            absolute(path);
        }
        if let HeadShape::Mesh(mesh) = &mut self.head.shape {
            absolute(&mut mesh.path);
        }
        for solid in &mut self.solids {
            if let SolidShape::Mesh(mesh) = &mut solid.shape {
                absolute(&mut mesh.path);
            }
            if let MotionSpec::Bvh { path, .. } = &mut solid.motion {
                absolute(path);
            }
        }
        let recorded = self.train.recorded.iter_mut().map(|r| &mut r.motion);
        for motion in recorded.chain([&mut self.head.motion]) {
            if let MotionSpec::Bvh { path, .. } = motion {
                absolute(path);
            }
        }
    }

    /// Motion of the head over the scene: poses `world_from_head`.
    ///
    /// # Errors
    /// When a BVH file cannot be read or lacks the joint.
    pub fn head_motion(&self) -> Result<PoseMotion> {
        self.head.motion.load(self.seconds, self.head.pivot_cm)
    }

    /// Number of whole steps in the scene.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        (self.seconds / self.step_s).round() as usize
    }
}

impl GroomSource {
    /// Reads, scales and places a groom file; `None` for a generated groom, which other code makes.
    ///
    /// # Errors
    /// Those of the reader. Strands may still be degenerate.
    pub fn load_file(&self) -> Result<Option<Groom>> {
        match self {
            Self::File { path, unit, negate, translate_cm } => {
                let groom = read_groom(path, *unit)?;
                Ok(Some(groom.transformed(1.0, negate_axes(*negate), translate_cm.map(|x| x as f32))))
            }
            Self::Generated(_) => Ok(None),
        }
    }
}

impl MeshSource {
    /// Reads the mesh, then centres and rotates it as asked (cm).
    ///
    /// # Errors
    /// Those of the reader.
    pub fn load(&self) -> Result<TriMesh> {
        let mut mesh = read_mesh(&self.path, self.unit)?;
        const IDENTITY: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        if let (true, Some((lo, hi))) = (self.center, mesh.bounds()) {
            mesh = mesh.transformed(1.0, IDENTITY, std::array::from_fn(|k| -0.5 * (lo[k] + hi[k])));
        }
        if self.rotate_deg != [0.0; 3] {
            let r = rotation(self.rotate_deg).to_rotation_matrix();
            let rows = std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)] as f32));
            mesh = mesh.transformed(1.0, rows, [0.0; 3]);
        }
        Ok(mesh)
    }
}

impl MotionSpec {
    /// The motion over `seconds`, turning about `pivot_cm`.
    ///
    /// # Errors
    /// When a BVH file cannot be read or lacks the joint.
    pub fn load(&self, seconds: f64, pivot_cm: [f64; 3]) -> Result<PoseMotion> {
        let pivot = Vector3::from(pivot_cm);
        match self {
            Self::Still => Ok(PoseMotion::still()),
            Self::Keys(keys) => {
                let keys: Vec<PoseKey> = keys.iter().map(KeySpec::pose).collect();
                PoseMotion::about_pivot(&keys, pivot)
            }
            Self::Bvh { path, joint, unit, skip_frames, yaw_deg, repeat } => {
                let bvh = Bvh::read(path)?;
                let joint = bvh.joint_index(joint)?;
                let cm = unit.cm_per_unit();
                let end = if *repeat { MotionEnd::Repeat { until_s: seconds } } else { MotionEnd::Hold };
                PoseMotion::from_bvh_turned(&bvh, joint, cm, *skip_frames, yaw_deg.to_radians(), pivot, end)
            }
        }
    }
}

impl KeySpec {
    fn pose(&self) -> PoseKey {
        PoseKey {
            time_s: self.t,
            translation_cm: Vector3::from(self.translate_cm),
            rotation: rotation(self.rotate_deg),
        }
    }
}

impl MaterialSpec {
    /// `preset` with the constants replaced that the scene states.
    #[must_use]
    pub fn apply(&self, preset: MaterialRecord) -> MaterialRecord {
        MaterialRecord {
            stretch_dyn: self.stretch_dyn.unwrap_or(preset.stretch_dyn),
            bend: self.bend.unwrap_or(preset.bend),
            twist: self.twist.unwrap_or(preset.twist),
            stretch_damping: self.stretch_damping.unwrap_or(preset.stretch_damping),
            bend_damping: self.bend_damping.unwrap_or(preset.bend_damping),
            twist_damping: self.twist_damping.unwrap_or(preset.twist_damping),
            friction: self.friction.unwrap_or(preset.friction),
            linear_density_g_per_cm: self.linear_density_g_per_cm.unwrap_or(preset.linear_density_g_per_cm),
            air_drag_per_s: self.air_drag_per_s.unwrap_or(preset.air_drag_per_s),
        }
    }
}

/// Rotation about fixed x, then y, then z.
fn rotation(deg: [f64; 3]) -> UnitQuaternion<f64> {
    let [x, y, z] = deg.map(f64::to_radians);
    UnitQuaternion::from_euler_angles(x, y, z)
}
