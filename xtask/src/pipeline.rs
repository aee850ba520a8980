//! From a scene to a trained model and to what runs are compared with; every stage keyed by a hash of its inputs.
//!
//! Stage outputs live in `out/cache`, named by stage and key. A stage whose file is whole is not done again; a killed run
//! resumes and ends with the same bytes, and several processes may share the work (`recording.rs`, `skinning_train`).
//! Baked solids of meshes lie in `out/cache/solids`, each under a hash of its mesh.

use crate::progress::Bars;
use crate::recording::Recorder;
use anyhow::{Context, Result, bail};
use hair_bench::run::{ErrorPct, Mode, Reference, RunResult, blind_reach, replayed_error, run};
use hair_bench::training_motions::{TrainingMotion, training_motions};
use hair_bench::world::World;
use io_formats::frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter, JoinedFrames};
use io_formats::groom::UniformGroom;
use io_formats::scene::{GroomSource, HairStyle, HeadShape, MotionUse, Scene, SolidShape};
use io_formats::skinning_model::SkinningModel;
use io_formats::stage_cache::{hash_of, stage_key};
use io_formats::{BakeCache, StageCache, StageCost};
use serde::{Deserialize, Serialize};
use skinning_train::{JudgedFit, TrainInputs, TrainParams, TrainReport, Trainer, model_key};
use std::ops::Range;
use std::path::{Path, PathBuf};
use strand_sim::StepParams;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change makes stage outputs of equal inputs differ.
const PIPELINE_VERSION: u64 = 12;

/// Strands on which numbers of guides are compared.
const JUDGED_STRANDS: usize = 2000;

/// Scenes that come with the program, by name.
const BUILT_IN: [(&str, &str); 12] = [
    ("salon", include_str!("../../bench/scenes/salon.toml")),
    ("full-head", include_str!("../../bench/scenes/full-head.toml")),
    ("head-20k", include_str!("../../bench/scenes/head-20k.toml")),
    ("salon-full", include_str!("../../bench/scenes/salon-full.toml")),
    ("comb-fine", include_str!("../../bench/scenes/comb-fine.toml")),
    ("comb-coarse", include_str!("../../bench/scenes/comb-coarse.toml")),
    ("comb-fast", include_str!("../../bench/scenes/comb-fast.toml")),
    ("sphere-sweep", include_str!("../../bench/scenes/sphere-sweep.toml")),
    ("gears", include_str!("../../bench/scenes/gears.toml")),
    ("hairy-ball", include_str!("../../bench/scenes/hairy-ball.toml")),
    ("fig6-rod", include_str!("../../bench/scenes/fig6-rod.toml")),
    ("fig6-lift", include_str!("../../bench/scenes/fig6-lift.toml")),
];

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
pub struct Prepared<'a> {
    pub workshop: Workshop<'a>,
    pub model: SkinningModel,
    pub report: TrainReport,
    /// Not taken from the cache.
    pub trained_now: bool,
    /// Where the model lies.
    pub path: PathBuf,
    pub cache: PathBuf,
    key: u64,
}

impl Prepared<'_> {
    pub fn world(&self) -> &World {
        &self.workshop.world
    }
}

fn hash_points(points: &[[f32; 3]]) -> u64 {
    let bytes: Vec<u8> = points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    xxh3_64(&bytes)
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
    Ok(stage_key("files", &hashes))
}

/// A world, and where the stages of its training are kept.
pub struct Workshop<'a> {
    pub world: World,
    pub motions: Vec<TrainingMotion>,
    cache: StageCache,
    folder: PathBuf,
    rest_key: u64,
    bars: &'a Bars,
}

impl<'a> Workshop<'a> {
    /// Builds the world of a scene; `out` is the folder of results and cache.
    pub fn open(scene: Scene, out: &Path, bars: &'a Bars) -> Result<Self> {
        let folder = out.join("cache");
        let cache = StageCache::in_directory(&folder)?;
        let spinner = bars.spinner("scene");
        let solids = BakeCache::in_directory(&folder.join("solids"));
        let world = World::build_with(scene, Some(&solids), |what| spinner.set_message(what.to_owned()))?;
        spinner.finish_and_clear();
        if world.dropped_strands > 0 {
            bars.note(&format!("{} strands without length were left out", world.dropped_strands));
        }
        let motions = training_motions(&world.scene)?;
        let parts = [
            PIPELINE_VERSION,
            u64::from(io_formats::frames::VERSION),
            hash_points(&world.groom.points),
            hash_of(&world.scene.head.shape),
            hash_of(&world.material),
            hash_of(&StepParams::standard()),
            hash_files(&world.scene)?,
        ];
        Ok(Self { rest_key: stage_key("rest", &parts), world, motions, cache, folder, bars })
    }

    pub fn recorder(&self) -> Recorder<'_> {
        Recorder {
            world: &self.world,
            params: StepParams::standard(),
            cache: &self.cache,
            folder: &self.folder,
            bars: self.bars,
            rest_key: self.rest_key,
        }
    }

    /// The motions of one use.
    pub fn motions_for(&self, used_for: MotionUse) -> impl Iterator<Item = &TrainingMotion> {
        self.motions.iter().filter(move |m| m.used_for == used_for)
    }

    fn params(&self) -> TrainParams {
        let scene = &self.world.scene;
        let mut params = TrainParams::standard(scene.groom.guides.min(self.world.groom.n_strands));
        params.max_eligible = scene.groom.max_eligible;
        params.min_eligible = params.min_eligible.min(scene.groom.max_eligible);
        params.sparsity = scene.train.sparsity;
        params.min_weight = scene.train.min_weight;
        params.seed = scene.train.seed;
        params
    }

    /// Hash of everything training sees.
    fn inputs_key(&self) -> u64 {
        let recorder = self.recorder();
        let frames: Vec<u64> = self.motions_for(MotionUse::Train).map(|m| recorder.key(m)).collect();
        stage_key("inputs", &[self.rest_key, stage_key("sequences", &frames)])
    }

    /// Frames of all motions of one use, recorded if need be; none if there is no such motion.
    pub fn frames_for(&self, rest: &UniformGroom, used_for: MotionUse) -> Result<Option<JoinedFrames>> {
        let recorder = self.recorder();
        let stores = recorder.frames(rest, self.motions_for(used_for))?;
        Ok(if stores.is_empty() { None } else { Some(JoinedFrames::new(stores)?) })
    }

    /// Records the motions of these numbers and stops: the work of one of several processes.
    pub fn record(&self, numbers: Range<usize>) -> Result<usize> {
        let rest = self.recorder().settled()?;
        let chosen = &self.motions[numbers.start.min(self.motions.len())..numbers.end.min(self.motions.len())];
        self.recorder().frames(&rest, chosen.iter())?;
        Ok(chosen.len())
    }

    /// Runs `work` on a training of recorded frames.
    fn with_trainer<T>(
        &self,
        params: &TrainParams,
        work: impl FnOnce(Trainer<'_>) -> skinning_train::Result<T>,
    ) -> Result<T> {
        let rest = self.recorder().settled()?;
        let frames = self.frames_for(&rest, MotionUse::Train)?.context("no motion to train on")?;
        let inputs = TrainInputs {
            rest: &rest,
            groom: &self.world.groom,
            material: adaptive_runtime::record_of(&self.world.material),
            provenance: self.inputs_key(),
        };
        let mut stage = self.bars.stages();
        let mut tell = |p: skinning_train::Progress| stage.set(p.stage, p.done, p.total);
        let result = Trainer::new(&frames, inputs, params, Some(&self.cache), &mut tell).and_then(work);
        stage.finish();
        result.context("training")
    }

    /// Solves the weights of these strands and stops: the work of one of several processes.
    pub fn solve(&self, strands: Range<usize>) -> Result<()> {
        self.with_trainer(&self.params(), |mut trainer| trainer.solve_weights(strands))
    }

    /// Errors with fewer guides, judged on the validation motion, and what finding them took beside the training itself;
    /// empty if there is no such motion.
    pub fn error_by_guides(&self) -> Result<(Vec<JudgedFit>, StageCost)> {
        let recorder = self.recorder();
        let mut cost = StageCost::default();
        let Some(judged) = self.frames_for(&recorder.settled()?, MotionUse::Validation)? else {
            return Ok((Vec::new(), cost));
        };
        let keys: Vec<u64> = self.motions_for(MotionUse::Validation).map(|m| recorder.key(m)).collect();
        let params = self.params();
        let mut counts = [8, 4, 2, 1].map(|share| (params.n_guides / share).max(1)).to_vec();
        counts.dedup();
        let mut fits = Vec::new();
        for n_guides in counts {
            let fewer = TrainParams { n_guides, n_compared: JUDGED_STRANDS, ..params.clone() };
            let (fit, costs) = self.with_trainer(&fewer, |mut trainer| {
                Ok((trainer.judge(&judged, stage_key("judged", &keys))?, trainer.costs().to_vec()))
            })?;
            fits.push(fit);
            let is_own = |stage: &str| stage == "judge" || (n_guides < params.n_guides && stage != "reduce");
            costs.iter().filter(|(stage, _)| is_own(stage)).for_each(|(_, c)| cost += *c);
        }
        Ok((fits, cost))
    }

    /// Trains the model, or takes it from the cache.
    pub fn train(self) -> Result<Prepared<'a>> {
        let key = model_key(self.inputs_key(), &self.params());
        let path = self.folder.join(format!("model-{key:016x}.skin"));
        // One process at a time finishes a model; others wait and find it.
        let lock = self.cache.lock("model", key)?;
        // A report that cannot be read is made again, from stages that are there.
        if path.exists()
            && let Ok(Some(report)) = self.cache.load("report", key)
        {
            let model = SkinningModel::load(&path).with_context(|| format!("the cached model {}", path.display()))?;
            return Ok(Prepared {
                model,
                report,
                trained_now: false,
                path,
                cache: self.folder.clone(),
                key,
                workshop: self,
            });
        }
        let (model, report) = self.with_trainer(&self.params(), |trainer| trainer.finish())?;
        model.save(&path)?;
        self.cache.save("report", key, &report)?;
        drop(lock);
        Ok(Prepared { model, report, trained_now: true, path, cache: self.folder.clone(), key, workshop: self })
    }
}

/// Builds the world and trains its model, or takes the model from the cache.
pub fn prepare<'a>(scene: Scene, out: &Path, bars: &'a Bars) -> Result<Prepared<'a>> {
    Workshop::open(scene, out, bars)?.train()
}

/// Error of skinning alone on the scene's held-out head motion; `None` if the scene asks for none.
pub fn held_out_error(prepared: &Prepared<'_>, bars: &Bars) -> Result<Option<ErrorPct>> {
    let rest = prepared.workshop.recorder().settled()?;
    let Some(frames) = prepared.workshop.frames_for(&rest, MotionUse::HeldOut)? else { return Ok(None) };
    let bar = bars.bar("held-out error", frames.n_frames() as u64);
    let error = replayed_error(&prepared.model, &frames, |frame| bar.set_position(frame as u64))?;
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
pub fn reference(prepared: &Prepared<'_>, with_full: bool, bars: &Bars) -> Result<Reference> {
    let world = prepared.world();
    let scene = &world.scene;
    let motion: Vec<u64> = (0..=world.n_steps())
        .map(|k| {
            let t = k as f64 * scene.step_s;
            hash_of(&(world.world_from_head(t), world.world_from_solids(t)))
        })
        .collect();
    let key = stage_key(
        "reference",
        &[
            prepared.key,
            hash_of(&scene.solids),
            hash_files(scene)?,
            scene.fps.to_bits(),
            stage_key("motion", &motion),
            u64::from(with_full),
        ],
    );
    let path = prepared.cache.join(format!("reference-{key:016x}.json"));
    let frames_path = prepared.cache.join(format!("reference-{key:016x}.frames"));
    let _lock = prepared.workshop.cache.lock("reference", key)?;
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
