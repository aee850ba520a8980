//! Progress bars with the time left, on a terminal; plain lines elsewhere.

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

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
    pub fn bar(&self, name: &str, total: u64) -> ProgressBar {
        let bar = self.bars.add(ProgressBar::new(total));
        let style = ProgressStyle::with_template("{msg:>22} {wide_bar} {percent:>3}%  {elapsed} gone, {eta} left");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.set_message(name.to_owned());
        if !std::io::stderr().is_terminal() {
            eprintln!("{name} ...");
        }
        bar
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

/// The bar of a command of several stages.
pub struct Stages<'a> {
    bars: &'a Bars,
    current: Option<(&'static str, ProgressBar, Instant)>,
}

impl Stages<'_> {
    /// Shows that `done` of `total` units of `stage` are done.
    pub fn set(&mut self, stage: &'static str, done: u64, total: u64) {
        if self.current.as_ref().is_none_or(|(name, ..)| *name != stage) {
            self.finish();
            self.current = Some((stage, self.bars.bar(stage, total), Instant::now()));
        }
        if let Some((_, bar, _)) = &self.current {
            bar.set_length(total);
            bar.set_position(done);
        }
    }

    /// Removes the bar.
    pub fn finish(&mut self) {
        if let Some((_, bar, _)) = self.current.take() {
            bar.finish_and_clear();
        }
    }
}
