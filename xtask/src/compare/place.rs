//! Where experiments run: trained models from the cache, pictures into the report's folder, progress on the terminal.

use super::kept::PICTURES;
use crate::painter::{Painter, camera, sized};
use crate::pipeline::{load_scene, prepare};
use crate::presets::Preset;
use crate::progress::{Bar, Bars};
use crate::train::stage_costs;
use crate::workspace_root;
use anyhow::{Context, Result};
use hair_bench::Error;
use hair_bench::evidence::{Picture, Place, Size, Trained, View};
use io_formats::scene::{Scene, TrainSpec};
use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// Height of the report's pictures, pixels.
const HEIGHT: usize = 480;
/// That of a report of smaller heads, which show less.
const QUICK_HEIGHT: usize = 320;
/// Colours of a picture: hair has few hues, a backdrop many shades.
const COLOURS: usize = 256;

/// Which pictures are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pictures {
    /// None.
    None,
    /// By the renderer if there is a driver, and not `plain`.
    Best {
        /// By the plain rasteriser in any case.
        plain: bool,
    },
}

/// The place of one run of `xtask compare`.
pub struct Workplace<'a> {
    size: Size,
    out: PathBuf,
    pictures: Pictures,
    bars: &'a Bars,
    painter: RefCell<Option<Painter>>,
    /// Name and folder of the experiment under way, and whether it has drawn.
    current: RefCell<Current>,
    bar: RefCell<Option<(String, Bar)>>,
}

#[derive(Default)]
struct Current {
    name: String,
    folder: PathBuf,
    has_drawn: bool,
}

impl<'a> Workplace<'a> {
    /// A place for experiments of a size; `out` is the folder of the cache.
    pub fn new(size: Size, out: &Path, pictures: Pictures, bars: &'a Bars) -> Self {
        Self {
            size,
            out: out.to_path_buf(),
            pictures,
            bars,
            painter: RefCell::new(None),
            current: RefCell::new(Current::default()),
            bar: RefCell::new(None),
        }
    }

    /// What the report should say of how it was made.
    pub fn notes(&self) -> Vec<String> {
        if self.pictures == Pictures::None {
            return vec!["Pictures were left out (--no-pictures).".to_owned()];
        }
        let painter = self.painter.borrow();
        painter.as_ref().and_then(Painter::note).map(|note| format!("In this run {note}.")).into_iter().collect()
    }

    fn try_draw(&self, name: &str, caption: &str, row: &str, view: &View) -> Result<Picture> {
        let mut current = self.current.borrow_mut();
        let safe = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '-' };
        let name: String = format!("{}-{name}", current.name).chars().map(safe).collect();
        let file = format!("{PICTURES}/{name}.png");
        let picture = Picture { caption: caption.to_owned(), file, row: row.to_owned() };
        let Pictures::Best { plain } = self.pictures else { return Ok(picture) };
        let mut painter = self.painter.borrow_mut();
        let painter = painter.get_or_insert_with(|| if plain { Painter::plain() } else { Painter::best(self.bars) });
        let height = if self.size == Size::Full { HEIGHT } else { QUICK_HEIGHT };
        let camera = sized(camera(view.world), Some(height)).turned(view.turn);
        let image = painter.picture(view.world, view.t, view.positions, view.colors, camera)?;
        let path = current.folder.join(&picture.file);
        let folder = path.parent().unwrap_or(&current.folder);
        std::fs::create_dir_all(folder).with_context(|| format!("creating {}", folder.display()))?;
        image.write_small_png(&path, COLOURS)?;
        current.has_drawn = true;
        Ok(picture)
    }
}

/// What the one who runs experiments does with their place.
pub trait Station: Place {
    /// An experiment begins; its pictures go under this folder.
    fn begin(&self, name: &str, folder: &Path);

    /// It has ended; answers who drew its pictures, if it has any.
    fn end(&self) -> Option<String>;

    /// Whether pictures are drawn.
    fn draws(&self) -> bool;

    /// What experiments see of it.
    fn as_place(&self) -> &dyn Place;
}

impl Station for Workplace<'_> {
    fn begin(&self, name: &str, folder: &Path) {
        *self.current.borrow_mut() = Current { name: name.to_owned(), folder: folder.to_path_buf(), has_drawn: false };
    }

    fn end(&self) -> Option<String> {
        *self.bar.borrow_mut() = None;
        let painter = self.painter.borrow();
        let painter = painter.as_ref().filter(|_| self.current.borrow().has_drawn)?;
        Some(painter.name().to_owned())
    }

    fn draws(&self) -> bool {
        self.pictures != Pictures::None
    }

    fn as_place(&self) -> &dyn Place {
        self
    }
}

fn in_place(what: String) -> impl FnOnce(anyhow::Error) -> Error {
    // Its whole chain in one line: a report has no room for a list of causes.
    |error| Error::Place { what, source: format!("{error:#}").into() }
}

/// Whether a scene says nothing of how much to train it.
fn says_nothing(train: &TrainSpec) -> bool {
    let TrainSpec { sequences, seconds_per_sequence, fps, friction, validation_seconds, held_out_seconds, .. } =
        TrainSpec::default();
    train.sequences == sequences
        && train.seconds_per_sequence == seconds_per_sequence
        && train.fps == fps
        && train.friction == friction
        && train.validation_seconds == validation_seconds
        && train.held_out_seconds == held_out_seconds
        && train.recorded.is_empty()
}

impl Place for Workplace<'_> {
    fn size(&self) -> Size {
        self.size
    }

    fn scene(&self, name: &str) -> Result<Scene, Error> {
        load_scene(name, None).map_err(in_place(format!("scene {name}")))
    }

    fn trained(&self, mut scene: Scene) -> Result<Trained, Error> {
        // The papers' sizes are trained no more than their runs need, unless the scene asks for more.
        if says_nothing(&scene.train) {
            Preset::Bench.apply(&mut scene);
        }
        let name = scene.name.clone();
        let prepared = prepare(scene, &self.out, self.bars).map_err(in_place(format!("a model for {name}")))?;
        let training = stage_costs(&prepared);
        Ok(Trained { world: prepared.workshop.world, model: prepared.model, training })
    }

    fn draw(&self, name: &str, caption: &str, row: &str, view: &View) -> Result<Picture, Error> {
        self.try_draw(name, caption, row, view).map_err(in_place(format!("picture {name}")))
    }

    fn data(&self, name: &str) -> Option<PathBuf> {
        let path = workspace_root().join("../shared/data").join(name);
        path.exists().then_some(path)
    }

    fn progress(&self, what: &str, done: usize, of: usize) {
        let mut bar = self.bar.borrow_mut();
        if bar.as_ref().is_none_or(|(name, _)| name != what) {
            *bar = Some((what.to_owned(), self.bars.bar(what, of as u64)));
        }
        if let Some((_, shown)) = &*bar {
            shown.set_length(of as u64);
            shown.set_position(done as u64);
        }
        if done >= of {
            *bar = None;
        }
    }
}
