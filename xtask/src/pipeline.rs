//! From a scene to a trained model and to what runs are compared with; every stage keyed by a hash of its inputs.
//!
//! Stage outputs live in `out/cache`, named by stage and key. A stage whose file is whole is not done again; recorded
//! frames continue after the last whole one, so a killed run resumes and ends with the same bytes.
//! Baked solids of meshes lie in `out/cache/solids`, each under a hash of its mesh.

use crate::progress::Bars;
use anyhow::{Context, Result, bail};
use hair_bench::full_space::settle;
use hair_bench::head_motion::{HeadMotionParams, random_head_motion};
use hair_bench::run::{ErrorPct, Mode, Reference, RunResult, blind_reach, replayed_error, run};
use hair_bench::world::World;
use io_formats::BakeCache;
use io_formats::frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter};
use io_formats::groom::UniformGroom;
use io_formats::scene::{GroomSource, HairStyle, HeadShape, Scene, SolidShape};
use io_formats::skinning_model::SkinningModel;
use serde::{Deserialize, Serialize};
use skinning_train::{TrainInputs, TrainParams, TrainReport, train};
use std::path::{Path, PathBuf};
use strand_sim::StepParams;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change makes stage outputs of equal inputs differ.
const PIPELINE_VERSION: u64 = 10;

/// Scenes that come with the program, by name.
const BUILT_IN: [(&str, &str); 1] = [("salon", include_str!("../../bench/scenes/salon.toml"))];

/// Step of the full-space simulation that frames are recorded from, s.
const TRAIN_STEP_S: f64 = 0.01;

/// Reads a scene file, or one that comes with the program, or makes one around a bare groom file.
pub fn load_scene(name: &str, unit: Option<&str>) -> Result<Scene> {
    if let Some((_, text)) = BUILT_IN.iter().find(|(known, _)| *known == name) {
        return Scene::from_toml(text, Path::new(".")).with_context(|| format!("the built-in scene {name}"));
    }
    let path = Path::new(name);
    match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => Scene::read(path).with_context(|| format!("reading scene {name}")),
        Some("hair" | "tfx" | "data" | "ply") => {
            let Some(unit) = unit else {
                bail!("{name} is a groom without a unit of length: add --unit m, cm, mm, in, or centimetres per unit");
            };
            let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("groom");
            let text = format!("name = {stem:?}\n[groom]\nfile = {name:?}\nunit = {unit:?}\n");
            Scene::from_toml(&text, Path::new("")).with_context(|| format!("a scene around groom {name}"))
        }
        _ => {
            let known: Vec<_> = BUILT_IN.iter().map(|(known, _)| *known).collect();
            bail!(
                "{name} is neither a .toml scene, a .hair, .tfx, .data or .ply groom, nor a built-in scene ({})",
                known.join(", ")
            )
        }
    }
}

/// A world with its trained model.
pub struct Prepared {
    pub world: World,
    pub model: SkinningModel,
    /// Present when the model was trained just now.
    pub report: Option<TrainReport>,
    pub cache: PathBuf,
    key: u64,
}

/// Hash of a stage: its name, the pipeline's version, and all it is made from.
fn key_of(stage: &str, parts: &[u64]) -> u64 {
    let mut bytes = stage.as_bytes().to_vec();
    bytes.extend(PIPELINE_VERSION.to_le_bytes());
    parts.iter().for_each(|p| bytes.extend(p.to_le_bytes()));
    xxh3_64(&bytes)
}

fn hash_points(points: &[[f32; 3]]) -> u64 {
    let bytes: Vec<u8> = points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    xxh3_64(&bytes)
}

fn hash_text(value: &impl std::fmt::Debug) -> u64 {
    xxh3_64(format!("{value:?}").as_bytes())
}

/// Contents of the files that shape the scene's solids: a changed mesh is a changed scene.
fn hash_files(scene: &Scene) -> Result<u64> {
    let mut paths: Vec<&Path> = Vec::new();
    if let HeadShape::Mesh(source) = &scene.head.shape {
        paths.push(&source.path);
    }
    for solid in &scene.solids {
        if let SolidShape::Mesh(source) = &solid.shape {
            paths.push(&source.path);
        }
    }
    let mut hashes = Vec::new();
    for path in paths {
        hashes.push(xxh3_64(&std::fs::read(path).with_context(|| format!("reading {}", path.display()))?));
    }
    Ok(key_of("files", &hashes))
}

/// Builds the world and trains its model, or takes the model from the cache.
pub fn prepare(scene: Scene, out: &Path, bars: &Bars) -> Result<Prepared> {
    let cache = out.join("cache");
    std::fs::create_dir_all(&cache).with_context(|| format!("creating {}", cache.display()))?;
    let spinner = bars.spinner("scene");
    let solids = BakeCache::in_directory(&cache.join("solids"));
    let world = World::build_with(scene, Some(&solids), |what| spinner.set_message(what.to_owned()))?;
    spinner.finish_and_clear();
    if world.dropped_strands > 0 {
        bars.note(&format!("{} strands without length were left out", world.dropped_strands));
    }
    let scene = &world.scene;
    let params = StepParams::standard();
    let rest_key = key_of(
        "rest",
        &[
            hash_points(&world.groom.points),
            hash_text(&scene.head.shape),
            hash_text(&world.material),
            hash_text(&params),
        ],
    );
    let rest_key = key_of("rest", &[rest_key, hash_files(scene)?]);
    let rest = settled(&world, &cache.join(format!("rest-{rest_key:016x}.frames")), rest_key, &params, bars)?;
    let frames_key = key_of(
        "frames",
        &[
            rest_key,
            scene.train.sequences as u64,
            scene.train.seconds_per_sequence.to_bits(),
            scene.train.fps.to_bits(),
            scene.train.seed,
            u64::from(scene.train.friction),
        ],
    );
    let mut train_params = TrainParams::standard(scene.groom.guides.min(world.groom.n_strands));
    train_params.max_eligible = scene.groom.max_eligible;
    train_params.min_eligible = train_params.min_eligible.min(scene.groom.max_eligible);
    train_params.sparsity = scene.train.sparsity;
    train_params.min_weight = scene.train.min_weight;
    train_params.seed = scene.train.seed;
    let model_key = key_of("model", &[frames_key, hash_text(&train_params)]);
    let path = cache.join(format!("model-{model_key:016x}.skin"));
    if path.exists() {
        let model = SkinningModel::load(&path).with_context(|| format!("the cached model {}", path.display()))?;
        return Ok(Prepared { world, model, report: None, cache, key: model_key });
    }
    let frames =
        recorded(&world, &rest, &cache.join(format!("frames-{frames_key:016x}.frames")), frames_key, &params, bars)?;
    let inputs = TrainInputs {
        rest: &rest,
        groom: &world.groom,
        material: adaptive_runtime::record_of(&world.material),
        provenance: model_key,
    };
    let mut stage = bars.stages();
    let (model, report) =
        train(&frames, &inputs, &train_params, &mut |p| stage.set(p.stage, p.done, p.total)).context("training")?;
    stage.finish();
    model.save(&path)?;
    Ok(Prepared { world, model, report: Some(report), cache, key: model_key })
}

/// The groom as it hangs, from the cache or by simulation.
fn settled(world: &World, path: &Path, key: u64, params: &StepParams, bars: &Bars) -> Result<UniformGroom> {
    let groom = &world.groom;
    let mut rest =
        UniformGroom { n_strands: groom.n_strands, n_particles: groom.n_particles, points: groom.points.clone() };
    if path.exists() {
        FrameStore::open(path)?.read(0, &mut rest.points)?;
        return Ok(rest);
    }
    let bar = bars.bar("settle", 100);
    rest = settle(groom, &world.head, world.material, params, |share| bar.set_position((100.0 * share) as u64))?;
    bar.finish_and_clear();
    let mut writer = FrameStoreWriter::create(path, rest.n_strands, rest.n_particles, key)?;
    writer.append(FrameInfo { sequence: 0, time_s: 0.0 }, &rest.points)?;
    writer.finish()?;
    Ok(rest)
}

/// Training frames, from the cache, continued, or recorded anew.
fn recorded(
    world: &World,
    rest: &UniformGroom,
    path: &Path,
    key: u64,
    params: &StepParams,
    bars: &Bars,
) -> Result<FrameStore> {
    if path.exists() {
        return Ok(FrameStore::open(path)?);
    }
    let spec = &world.scene.train;
    let steps = (spec.seconds_per_sequence / TRAIN_STEP_S).round() as usize;
    let bar = bars.bar("full-space frames", (spec.sequences * steps) as u64);
    let mut writer = FrameStoreWriter::resume(path, rest.n_strands, rest.n_particles, key)?;
    let is_frame = |step: usize| {
        let frame = |step: usize| (step as f64 * TRAIN_STEP_S * spec.fps + 1e-9).floor();
        frame(step) > frame(step - 1)
    };
    let per_sequence = (1..=steps).filter(|&s| is_frame(s)).count();
    let mut positions = Vec::new();
    for sequence in 0..spec.sequences {
        let mut kept = writer.infos().len().saturating_sub(sequence * per_sequence).min(per_sequence);
        if kept == per_sequence {
            bar.inc(steps as u64);
            continue;
        }
        let motion =
            random_head_motion(spec.seed, sequence as u64, spec.seconds_per_sequence, &HeadMotionParams::lively());
        let mut full = world.full_space(rest, params)?;
        for step in 1..=steps {
            let (before, now) = ((step - 1) as f64 * TRAIN_STEP_S, step as f64 * TRAIN_STEP_S);
            let (from, to) = (motion.pose_at(before), motion.pose_at(now));
            let head = collision::MovingSolid { solid: &world.head, pose: collision::SolidPose { from, to } };
            full.step(TRAIN_STEP_S, &to, &[head]);
            if is_frame(step) {
                if kept > 0 {
                    // Already on disk from a run that was cut off: simulated again only to go on from here.
                    kept -= 1;
                } else {
                    full.positions_in_head(&mut positions);
                    writer.append(FrameInfo { sequence: sequence as u32, time_s: now }, &positions)?;
                }
            }
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    writer.finish()?;
    Ok(FrameStore::open(path)?)
}

/// Error of skinning alone on the scene's held-out head motion; `None` if the scene asks for none.
pub fn held_out_error(prepared: &Prepared, bars: &Bars) -> Result<Option<ErrorPct>> {
    let (world, spec) = (&prepared.world, &prepared.world.scene.train);
    if spec.held_out_seconds == 0.0 {
        return Ok(None);
    }
    // Sequences of training are counted from zero.
    let sequence = spec.sequences as u64;
    let motion = random_head_motion(spec.seed, sequence, spec.held_out_seconds, &HeadMotionParams::lively());
    let bar = bars.bar("held-out motion", (spec.held_out_seconds / world.scene.step_s).round() as u64);
    let error = replayed_error(world, &prepared.model, &motion, spec.held_out_seconds, spec.fps, |s| {
        bar.set_position(s as u64);
    })?;
    bar.finish_and_clear();
    Ok(Some(error))
}

/// What of a [`Reference`] is kept beside its frames.
#[derive(Serialize, Deserialize)]
struct ReferenceFile {
    reach: Vec<Vec<u32>>,
    full: Option<RunResult>,
}

/// What all modes of the scene are measured against, from the cache or by a blind and, if asked, a full-space run.
pub fn reference(prepared: &Prepared, with_full: bool, bars: &Bars) -> Result<Reference> {
    let world = &prepared.world;
    let scene = &world.scene;
    let motion: Vec<u64> = (0..=world.n_steps())
        .map(|k| {
            let t = k as f64 * scene.step_s;
            hash_text(&(world.world_from_head(t), world.world_from_solids(t)))
        })
        .collect();
    let key = key_of(
        "reference",
        &[
            prepared.key,
            hash_text(&scene.solids),
            hash_files(scene)?,
            scene.fps.to_bits(),
            key_of("motion", &motion),
            u64::from(with_full),
        ],
    );
    let path = prepared.cache.join(format!("reference-{key:016x}.json"));
    let frames_path = prepared.cache.join(format!("reference-{key:016x}.frames"));
    if path.exists() && (!with_full || frames_path.exists()) {
        let text = std::fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
        let file: ReferenceFile = serde_json::from_str(&text)
            .with_context(|| format!("{} is damaged; delete it to measure again", path.display()))?;
        let mut frames = Vec::new();
        if with_full {
            let store = FrameStore::open(&frames_path)?;
            for frame in 0..store.n_frames() {
                let mut points = vec![[0.0; 3]; store.n_strands() * store.n_particles()];
                store.read(frame, &mut points)?;
                frames.push(points);
            }
        }
        return Ok(Reference { reach: file.reach, full: file.full, frames });
    }
    let bar = bars.bar("near strands", world.n_steps() as u64);
    let reach = blind_reach(world, &prepared.model, |step| bar.set_position(step as u64))?;
    bar.finish_and_clear();
    let mut reference = Reference { reach, full: None, frames: Vec::new() };
    if with_full {
        let model = &prepared.model;
        let (n_strands, n) = (model.n_strands as usize, model.n_particles as usize);
        let mut frames = Vec::new();
        let bar = bars.bar("full-space reference", world.n_steps() as u64);
        let full = run(
            world,
            model,
            Mode::FullSpace,
            &reference,
            |s| bar.set_position(s as u64),
            |t, points| {
                frames.push((t, points.to_vec()));
            },
        )?;
        bar.finish_and_clear();
        let mut writer = FrameStoreWriter::create(&frames_path, n_strands, n, key)?;
        for (time_s, points) in &frames {
            writer.append(FrameInfo { sequence: 0, time_s: *time_s }, points)?;
        }
        writer.finish()?;
        reference.full = Some(full);
        reference.frames = frames.into_iter().map(|(_, points)| points).collect();
    }
    let file = ReferenceFile { reach: reference.reach.clone(), full: reference.full.clone() };
    crate::report::write_beside(&path, serde_json::to_string(&file)?.as_bytes())?;
    Ok(reference)
}

/// What the groom of a scene is, in words.
pub fn describe(world: &World) -> String {
    let groom = match &world.scene.groom.source {
        GroomSource::Generated(spec) => match spec.style {
            HairStyle::Straight => "generated straight".to_owned(),
            HairStyle::Wavy => "generated wavy".to_owned(),
            HairStyle::Curly => "generated curly".to_owned(),
        },
        GroomSource::File { path, .. } => path.display().to_string(),
    };
    format!(
        "{groom}: {} strands x {} particles, {} guides",
        world.groom.n_strands, world.groom.n_particles, world.scene.groom.guides
    )
}

/// Sets the size of the worker pool; 0 leaves it to the machine.
pub fn use_threads(threads: usize) -> Result<()> {
    if threads > 0 {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("starting worker threads")?;
    }
    Ok(())
}
