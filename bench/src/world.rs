//! A scene made real: groom, head, solids and their motions, from a scene description.

use crate::error::Error;
use crate::grooms::{GroomParams, Style, generate};
use crate::shapes::{self, CombParams, solid_mesh};
use collision::{BakeParams, MovingSolid, Solid, SolidPose};
use io_formats::bvh::Bvh;
use io_formats::groom::{UniformGroom, negate_axes, read_groom};
use io_formats::mesh::{TriMesh, read_mesh};
use io_formats::motion::{MotionEnd, PoseKey, PoseMotion};
use io_formats::scene::{
    Attach, GroomSource, HairStyle, HeadShape, MaterialSpec, MeshSource, MotionSpec, Scene, SolidShape,
};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use strand_sim::Material;

/// Everything a run needs, in centimetres.
pub struct World {
    /// The description it was built from.
    pub scene: Scene,
    /// The styled groom, head frame.
    pub groom: UniformGroom,
    /// Strands without length that were left out, as the scene asked.
    pub dropped_strands: usize,
    /// What the hair is made of.
    pub material: Material,
    /// Head and body.
    pub head: Solid,
    /// Its surface.
    pub head_mesh: TriMesh,
    /// Its motion.
    pub head_motion: PoseMotion,
    /// All other solids.
    pub solids: Vec<Solid>,
    /// Their surfaces, each in its solid's frame.
    pub solid_meshes: Vec<TriMesh>,
    motions: Vec<(Attach, PoseMotion)>,
}

impl World {
    /// Reads, generates and bakes everything a scene names. `progress` is told what is being made.
    ///
    /// # Errors
    /// Whatever the named files or parameters have wrong.
    pub fn build(scene: Scene, mut progress: impl FnMut(&str)) -> Result<Self, Error> {
        progress("head");
        let (head, head_mesh) = match &scene.head.shape {
            HeadShape::BuiltIn => {
                let head = shapes::head()?;
                let mesh = solid_mesh(&head);
                (head, mesh)
            }
            HeadShape::Mesh(source) => bake("head", source, HEAD_FRICTION)?,
        };
        progress("groom");
        let (groom, dropped_strands) = build_groom(&scene, &head)?;
        let head_motion = motion(&scene.head.motion, scene.head.pivot_cm, scene.seconds)?;
        let mut solids = Vec::new();
        let mut solid_meshes = Vec::new();
        let mut motions = Vec::new();
        for spec in &scene.solids {
            progress(&spec.name);
            let (mut solid, mesh) = match &spec.shape {
                SolidShape::Mesh(source) => bake(&spec.name, source, spec.friction as f32)?,
                shape => {
                    let solid = match *shape {
                        SolidShape::Sphere { radius_cm } => shapes::sphere(radius_cm as f32)?,
                        SolidShape::Rod { radius_cm, length_cm } => shapes::rod(radius_cm as f32, length_cm as f32)?,
                        SolidShape::Comb { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm } => {
                            shapes::comb(CombParams {
                                teeth,
                                pitch_cm: pitch_cm as f32,
                                tooth_radius_cm: tooth_radius_cm as f32,
                                tooth_length_cm: tooth_length_cm as f32,
                                spine_radius_cm: spine_radius_cm as f32,
                            })?
                        }
                        SolidShape::Mesh(_) => unreachable!("matched above"),
                    };
                    let mesh = solid_mesh(&solid);
                    (solid, mesh)
                }
            };
            solid.name.clone_from(&spec.name);
            solid.friction = spec.friction as f32;
            solids.push(solid);
            solid_meshes.push(mesh);
            motions.push((spec.attach, motion(&spec.motion, [0.0; 3], scene.seconds)?));
        }
        let material = material(&scene.material);
        Ok(Self { scene, groom, dropped_strands, material, head, head_mesh, head_motion, solids, solid_meshes, motions })
    }

    /// Head pose at time `t`, s.
    #[must_use]
    pub fn world_from_head(&self, t: f64) -> Isometry3<f64> {
        self.head_motion.pose_at(t)
    }

    /// Poses of all solids at time `t`, s.
    #[must_use]
    pub fn world_from_solids(&self, t: f64) -> Vec<Isometry3<f64>> {
        self.motions
            .iter()
            .map(|(attach, motion)| match attach {
                Attach::World => motion.pose_at(t),
                Attach::Head => self.world_from_head(t) * motion.pose_at(t),
            })
            .collect()
    }

    /// The solids on their way from `t` to `t + dt`.
    #[must_use]
    pub fn moving_solids(&self, t: f64, dt: f64) -> Vec<MovingSolid<'_>> {
        let (from, to) = (self.world_from_solids(t), self.world_from_solids(t + dt));
        self.solids
            .iter()
            .zip(from.into_iter().zip(to))
            .map(|(solid, (from, to))| MovingSolid { solid, pose: SolidPose { from, to } })
            .collect()
    }

    /// The head on its way from `t` to `t + dt`.
    #[must_use]
    pub fn moving_head(&self, t: f64, dt: f64) -> MovingSolid<'_> {
        let pose = SolidPose { from: self.world_from_head(t), to: self.world_from_head(t + dt) };
        MovingSolid { solid: &self.head, pose }
    }

    /// Steps of the scene.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        (self.scene.seconds / self.scene.step_s).round() as usize
    }

    /// Whether the state after step `step` (counted from 1) is the first at or past a picture's time; step 0 always is.
    #[must_use]
    pub fn is_read(&self, step: usize) -> bool {
        let frame = |step: usize| (step as f64 * self.scene.step_s * self.scene.fps + 1e-9).floor();
        step == 0 || frame(step) > frame(step - 1)
    }
}

const HEAD_FRICTION: f32 = 0.1;

fn bake(name: &str, source: &MeshSource, friction: f32) -> Result<(Solid, TriMesh), Error> {
    let mut mesh = read_mesh(&source.path, source.unit)?;
    if source.center
        && let Some((min, max)) = mesh.bounds()
    {
        let middle: [f32; 3] = std::array::from_fn(|c| -0.5 * (min[c] + max[c]));
        mesh = mesh.transformed(1.0, IDENTITY, middle);
    }
    let [x, y, z] = source.rotate_deg.map(f64::to_radians);
    let turn = UnitQuaternion::from_euler_angles(x, y, z).to_rotation_matrix().cast::<f32>();
    let rows: [[f32; 3]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| turn[(r, c)]));
    mesh = mesh.transformed(1.0, rows, [0.0; 3]);
    let solid = Solid::from_mesh(name, &mesh.vertices, &mesh.triangles, BakeParams::standard(), friction)
        .map_err(|source| Error::Bake { name: name.to_owned(), source })?;
    Ok((solid, mesh))
}

const IDENTITY: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn build_groom(scene: &Scene, head: &Solid) -> Result<(UniformGroom, usize), Error> {
    match &scene.groom.source {
        GroomSource::Generator(spec) => {
            let style = match spec.style {
                HairStyle::Straight => Style::Straight,
                HairStyle::Wavy => Style::Wavy,
            };
            let params = GroomParams {
                style,
                strands: spec.strands,
                particles: scene.groom.particles,
                length_cm: spec.length_cm as f32,
                seed: spec.seed,
                head,
            };
            Ok((generate(&params)?, 0))
        }
        GroomSource::File { path, unit, negate, translate_cm } => {
            let mut groom = read_groom(path, *unit)?;
            groom = groom.transformed(1.0, negate_axes(*negate), translate_cm.map(|x| x as f32));
            let dropped = if scene.groom.drop_degenerate { groom.drop_degenerate() } else { 0 };
            groom.validate().map_err(|source| Error::Groom { path: path.clone(), source: Box::new(source) })?;
            Ok((groom.resample(scene.groom.particles)?, dropped))
        }
    }
}

fn motion(spec: &MotionSpec, pivot_cm: [f64; 3], seconds: f64) -> Result<PoseMotion, Error> {
    let pivot = Vector3::from(pivot_cm);
    Ok(match spec {
        MotionSpec::Still => PoseMotion::still(),
        MotionSpec::Keys(keys) => {
            let keys: Vec<PoseKey> = keys
                .iter()
                .map(|key| {
                    let [x, y, z] = key.rotate_deg.map(f64::to_radians);
                    PoseKey {
                        time_s: key.t,
                        translation_cm: Vector3::from(key.translate_cm),
                        rotation: UnitQuaternion::from_euler_angles(x, y, z),
                    }
                })
                .collect();
            PoseMotion::about_pivot(&keys, pivot)?
        }
        MotionSpec::Bvh { path, joint, unit, skip_frames, repeat, .. } => {
            let bvh = Bvh::read(path)?;
            let joint = bvh.joint_index(joint)?;
            let end = if *repeat { MotionEnd::Repeat { until_s: seconds } } else { MotionEnd::Hold };
            PoseMotion::from_bvh(&bvh, joint, unit.cm_per_unit(), *skip_frames, pivot, end)?
        }
    })
}

fn material(spec: &MaterialSpec) -> Material {
    let preset = match spec.preset {
        HairStyle::Straight => Material::straight(),
        HairStyle::Wavy => Material::wavy(),
    };
    Material {
        stretch_dyn: spec.stretch_dyn.unwrap_or(preset.stretch_dyn),
        bend_dyn: spec.bend.unwrap_or(preset.bend_dyn),
        twist_dyn: spec.twist.unwrap_or(preset.twist_dyn),
        stretch_damping: spec.stretch_damping.unwrap_or(preset.stretch_damping),
        bend_damping: spec.bend_damping.unwrap_or(preset.bend_damping),
        twist_damping: spec.twist_damping.unwrap_or(preset.twist_damping),
        friction: spec.friction.unwrap_or(preset.friction),
        linear_density_g_per_cm: spec.linear_density_g_per_cm.unwrap_or(preset.linear_density_g_per_cm),
        air_drag_per_s: spec.air_drag_per_s.unwrap_or(preset.air_drag_per_s),
    }
}
