//! A scene made real: groom, head, solids and their motions, from a scene description.

use crate::baked::solid_of_mesh;
use crate::error::Error;
use crate::grooms::{GroomParams, Style, generate, on_ball};
use crate::shapes::{self, CombParams, solid_mesh};
use crate::shapes_gear::{GearParams, gear_mesh};
use adaptive_runtime::{material_of, record_of};
use collision::{BakeParams, MovingSolid, Solid, SolidPose};
use io_formats::BakeCache;
use io_formats::densify::densify;
use io_formats::groom::UniformGroom;
use io_formats::mesh::TriMesh;
use io_formats::motion::PoseMotion;
use io_formats::scene::{Attach, GroomSource, HairStyle, HeadShape, MeshSource, Scene, SolidShape};
use nalgebra::{Isometry3, Vector3};
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
    pub fn build(scene: Scene, progress: impl FnMut(&str)) -> Result<Self, Error> {
        Self::build_with(scene, None, progress)
    }

    /// As [`Self::build`], with solids of meshes taken from a cache, or kept there.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_with(scene: Scene, cache: Option<&BakeCache>, mut progress: impl FnMut(&str)) -> Result<Self, Error> {
        progress("head");
        let (head, head_mesh) = match &scene.head.shape {
            HeadShape::Builtin => shapes::head_and_mesh()?,
            HeadShape::Ball(radius_cm) => {
                let ball = shapes::sphere(*radius_cm as f32)?;
                let mesh = solid_mesh(&ball);
                (ball, mesh)
            }
            HeadShape::Mesh(source) => bake("head", source, HEAD_FRICTION, cache)?,
        };
        progress("groom");
        let (groom, dropped_strands) = build_groom(&scene, &head)?;
        let head_motion = scene.head_motion()?;
        let Staged { solids, solid_meshes, motions } = stage(&scene, cache, &mut progress)?;
        let preset = match scene.material.preset {
            HairStyle::Straight => Material::straight(),
            HairStyle::Wavy => Material::wavy(),
            HairStyle::Curly => Material::curly(),
        };
        let material = material_of(&scene.material.apply(record_of(&preset)));
        Ok(Self {
            scene,
            groom,
            dropped_strands,
            material,
            head,
            head_mesh,
            head_motion,
            solids,
            solid_meshes,
            motions,
        })
    }

    /// The same hair on the same head, moved and met as another scene says; what that scene says of hair is left out.
    ///
    /// # Errors
    /// Whatever the scene's files or parameters have wrong.
    pub fn staged(&self, scene: Scene, cache: Option<&BakeCache>) -> Result<Self, Error> {
        let Staged { solids, solid_meshes, motions } = stage(&scene, cache, &mut |_| {})?;
        Ok(Self {
            groom: self.groom.clone(),
            dropped_strands: 0,
            material: self.material,
            head: self.head.clone(),
            head_mesh: self.head_mesh.clone(),
            head_motion: scene.head_motion()?,
            solids,
            solid_meshes,
            motions,
            scene,
        })
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
        self.scene.n_steps()
    }

    /// Whether the state after step `step` (counted from 1) is the first at or past a picture's time; step 0 always is.
    #[must_use]
    pub fn is_read(&self, step: usize) -> bool {
        let frame = |step: usize| (step as f64 * self.scene.step_s * self.scene.fps + 1e-9).floor();
        step == 0 || frame(step) > frame(step - 1)
    }
}

/// The solids of a scene, made.
struct Staged {
    solids: Vec<Solid>,
    solid_meshes: Vec<TriMesh>,
    motions: Vec<(Attach, PoseMotion)>,
}

fn stage(scene: &Scene, cache: Option<&BakeCache>, progress: &mut impl FnMut(&str)) -> Result<Staged, Error> {
    let mut solids = Vec::new();
    let mut solid_meshes = Vec::new();
    let mut motions = Vec::new();
    for spec in &scene.solids {
        progress(&spec.name);
        let meshed = |solid: Solid| {
            let mesh = solid_mesh(&solid);
            (solid, mesh)
        };
        let (mut solid, mesh) = match spec.shape {
            SolidShape::Mesh(ref source) => bake(&spec.name, source, spec.friction as f32, cache)?,
            SolidShape::Sphere { radius_cm } => meshed(shapes::sphere(radius_cm as f32)?),
            SolidShape::Rod { radius_cm, length_cm } => meshed(shapes::rod(radius_cm as f32, length_cm as f32)?),
            SolidShape::Gear { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm } => {
                let [radius_cm, tooth_cm, bore_cm, width_cm] =
                    [radius_cm, tooth_cm, bore_cm, width_cm].map(|x| x as f32);
                let mesh = gear_mesh(GearParams { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm })?;
                bake_mesh(&spec.name, mesh, spec.friction as f32, cache)?
            }
            SolidShape::Comb { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm } => {
                meshed(shapes::comb(CombParams {
                    teeth,
                    pitch_cm: pitch_cm as f32,
                    tooth_radius_cm: tooth_radius_cm as f32,
                    tooth_length_cm: tooth_length_cm as f32,
                    spine_radius_cm: spine_radius_cm as f32,
                })?)
            }
        };
        solid.name.clone_from(&spec.name);
        solid.friction = spec.friction as f32;
        solids.push(solid);
        solid_meshes.push(mesh);
        motions.push((spec.attach, spec.motion.load(scene.seconds, [0.0; 3])?));
    }
    Ok(Staged { solids, solid_meshes, motions })
}

const HEAD_FRICTION: f32 = 0.1;

fn bake(name: &str, source: &MeshSource, friction: f32, cache: Option<&BakeCache>) -> Result<(Solid, TriMesh), Error> {
    bake_mesh(name, source.load()?, friction, cache)
}

fn bake_mesh(name: &str, mesh: TriMesh, friction: f32, cache: Option<&BakeCache>) -> Result<(Solid, TriMesh), Error> {
    let (solid, origin) = solid_of_mesh(name, &mesh, BakeParams::automatic(), friction, cache)?;
    tracing::debug!(solid = name, ?origin, "solid of a mesh");
    Ok((solid, mesh))
}

fn build_groom(scene: &Scene, head: &Solid) -> Result<(UniformGroom, usize), Error> {
    match &scene.groom.source {
        GroomSource::Generated(spec) => {
            let style = match spec.style {
                HairStyle::Straight => Style::Straight,
                HairStyle::Wavy => Style::Wavy,
                HairStyle::Curly => Style::Curly,
            };
            let params = GroomParams {
                style,
                strands: spec.strands,
                particles: scene.groom.particles,
                length_cm: spec.length_cm as f32,
                seed: spec.seed,
                head,
            };
            let groom = match scene.head.shape {
                HeadShape::Ball(radius_cm) => on_ball(&params, radius_cm as f32)?,
                _ => generate(&params)?,
            };
            Ok((groom, 0))
        }
        GroomSource::File { path, .. } => {
            let in_file = |source| Error::Groom { path: path.clone(), source: Box::new(source) };
            let mut groom = scene.groom.source.load_file()?.unwrap_or_default();
            let dropped = if scene.groom.drop_degenerate { groom.drop_degenerate() } else { 0 };
            groom.validate().map_err(in_file)?;
            let groom = groom.resample(scene.groom.particles).map_err(in_file)?;
            let Some(n_strands) = scene.groom.densify_to else { return Ok((groom, dropped)) };
            let mut more = densify(&groom, n_strands, DENSIFY_SEED).map_err(in_file)?;
            stand_on(head, &groom, &mut more);
            Ok((more, dropped))
        }
    }
}

/// Seed of where strands grow between those of a file.
const DENSIFY_SEED: u64 = 1;

/// Moves strands that have grown between others out of or onto the head, to where their own neighbour stands: between roots
/// on a round head the straight way goes through it.
fn stand_on(head: &Solid, from: &UniformGroom, more: &mut UniformGroom) {
    const FARTHEST_CM: f32 = 1.0;
    let distance = |root: [f32; 3]| head.sdf.outward_normal(Vector3::from(root));
    for (k, strand) in more.points.chunks_exact_mut(from.n_particles).enumerate().skip(from.n_strands) {
        let (now, normal) = distance(strand[0]);
        let wanted = distance(from.strand(k % from.n_strands)[0]).0;
        let by = normal * (wanted - now).clamp(-FARTHEST_CM, FARTHEST_CM);
        strand.iter_mut().for_each(|p| *p = (Vector3::from(*p) + by).into());
    }
}
