//! Progress bars with the time left, on a terminal; a line now and then elsewhere.

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time between two lines about the same work where there is no terminal, s.
const LINE_EVERY_S: u64 = 20;

/// Where a command shows its progress.
pub struct Bars {
    bars: MultiProgress,
}

impl Bars {
    /// On standard error.
    pub fn new() -> Self {
        Self { bars: MultiProgress::with_draw_target(ProgressDrawTarget::stderr()) }
    }

    /// A bar of `total` units with the time left.
    pub fn bar(&self, name: &str, total: u64) -> Bar {
        let bar = self.bars.add(ProgressBar::new(total));
        let style = ProgressStyle::with_template("{msg:>22} {wide_bar} {percent:>3}%  {elapsed} gone, {eta} left");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_message(name.to_owned());
        if !std::io::stderr().is_terminal() {
            eprintln!("{name} ...");
        }
        Bar { bar, name: name.to_owned(), begin: Instant::now(), said_s: AtomicU64::new(0) }
    }

    /// A line for work of unknown length.
    pub fn spinner(&self, name: &str) -> ProgressBar {
        let bar = self.bars.add(ProgressBar::new_spinner());
        bar.set_message(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }

    /// A line that stays.
    pub fn note(&self, text: &str) {
        if self.bars.println(text).is_err() || !std::io::stderr().is_terminal() {
            eprintln!("{text}");
        }
    }

    /// A bar that changes its name and length with the stage.
    pub fn stages(&self) -> Stages<'_> {
        Stages { bars: self, current: None }
    }
}

/// One piece of work under way.
pub struct Bar {
    bar: ProgressBar,
    name: String,
    begin: Instant,
    /// Seconds after the beginning at which a line was last written.
    said_s: AtomicU64,
}

impl Bar {
    /// So many units are done.
    pub fn set_position(&self, done: u64) {
        self.bar.set_position(done);
        self.say();
    }

    /// So many more units are done.
    pub fn inc(&self, more: u64) {
        self.bar.inc(more);
        self.say();
    }

    /// There are so many units in all.
    pub fn set_length(&self, total: u64) {
        self.bar.set_length(total);
    }

    /// Removes the bar.
    pub fn finish_and_clear(&self) {
        self.bar.finish_and_clear();
    }

    fn say(&self) {
        let gone = self.begin.elapsed().as_secs();
        if gone < self.said_s.load(Ordering::Relaxed) + LINE_EVERY_S || std::io::stderr().is_terminal() {
            return;
        }
        self.said_s.store(gone, Ordering::Relaxed);
        let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
        let left = gone * total.saturating_sub(done) / done.max(1);
        eprintln!("{}: {} %, {gone} s gone, {left} s left", self.name, 100 * done / total);
    }
}

/// The bar of a command of several stages.
pub struct Stages<'a> {
    bars: &'a Bars,
    current: Option<(&'static str, Bar)>,
}

impl Stages<'_> {
    /// Shows that `done` of `total` units of `stage` are done.
    pub fn set(&mut self, stage: &'static str, done: u64, total: u64) {
        if self.current.as_ref().is_none_or(|(name, ..)| *name != stage) {
            self.finish();
            self.current = Some((stage, self.bars.bar(stage, total)));
        }
        if let Some((_, bar)) = &self.current {
            bar.set_length(total);
            bar.set_position(done);
        }
    }

    /// Removes the bar.
    pub fn finish(&mut self) {
        if let Some((_, bar)) = self.current.take() {
            bar.finish_and_clear();
        }
    }
}
