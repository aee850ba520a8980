//! A renderer in a program of its own: whoever wants pictures need not be built with what draws them.
//!
//! `hair-draw` (feature `gpu`) greets with the name of what draws, then answers every scene on its standard input with a
//! picture on its standard output, or with why there is none. It ends with its input.

use crate::error::Error;
use crate::image::Image;
use crate::scene::Scene;
use crate::wire::{Answer, read_answer, read_scene, write_answer, write_scene};
use std::io::{BufReader, BufWriter, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A running `hair-draw`. Dropping it ends it.
#[derive(Debug)]
pub struct RenderProcess {
    child: Child,
    // Gone only while it is being dropped.
    scenes: Option<BufWriter<ChildStdin>>,
    answers: BufReader<ChildStdout>,
    adapter: String,
}

impl RenderProcess {
    /// Starts the program and waits for its greeting; its standard error is the caller's.
    ///
    /// # Errors
    /// A program that does not start, or finds no driver.
    pub fn start(mut command: Command) -> Result<Self, Error> {
        let broken = |why: String| Error::Process { why };
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| broken(format!("{:?} does not start: {e}", command.get_program())))?;
        let (Some(scenes), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(broken("it has no input and output".to_owned()));
        };
        let (scenes, mut answers) = (Some(BufWriter::with_capacity(1 << 20, scenes)), BufReader::new(answers));
        let greeting = read_answer(&mut answers);
        let mut process = Self { child, scenes, answers, adapter: String::new() };
        match greeting {
            Ok(Answer::Name(name)) => process.adapter = name,
            Ok(Answer::Failed(why)) => return Err(broken(why)),
            Ok(Answer::Picture(_)) => return Err(broken("it is another program".to_owned())),
            Err(_) => return Err(broken("it ended before it could draw".to_owned())),
        }
        Ok(process)
    }

    /// What draws, as it names itself.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// Draws a scene.
    ///
    /// # Errors
    /// As `Renderer::picture`, in words.
    pub fn picture(&mut self, scene: &Scene) -> Result<Image, Error> {
        scene.check()?;
        let broken = |why: String| Error::Process { why };
        if let Some(pipe) = &mut self.scenes {
            write_scene(pipe, scene).map_err(|e| broken(format!("it takes no more scenes: {e}")))?;
        }
        match read_answer(&mut self.answers).map_err(|e| broken(format!("it ended while it drew: {e}")))? {
            Answer::Picture(image) => Ok(image),
            Answer::Failed(why) | Answer::Name(why) => Err(broken(why)),
        }
    }
}

impl Drop for RenderProcess {
    fn drop(&mut self) {
        // Its input ends, and so does it; how is of no interest any more.
        drop(self.scenes.take());
        let _ = self.child.wait();
    }
}

/// Greets with the name of what draws, or with why nothing does, then answers scenes until there are no more: all that
/// `hair-draw` does.
///
/// # Errors
/// A pipe that breaks while there is something to say.
pub fn serve<D: FnMut(&Scene) -> Result<Image, Error>>(
    ready: Result<(String, D), Error>,
    scenes: &mut impl Read,
    answers: &mut impl Write,
) -> std::io::Result<()> {
    let (name, mut draw) = match ready {
        Ok(ready) => ready,
        Err(error) => return write_answer(answers, &Answer::Failed(error.to_string())),
    };
    write_answer(answers, &Answer::Name(name))?;
    // A scene cut short is the end: whoever asks has gone.
    while let Ok(scene) = read_scene(scenes) {
        let answer = match draw(&scene.view()) {
            Ok(image) => Answer::Picture(image),
            Err(error) => Answer::Failed(error.to_string()),
        };
        write_answer(answers, &answer)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    #[test]
    fn every_scene_has_its_answer_and_a_failure_does_not_end_it() {
        let mut asked = Vec::new();
        for height in [1, 2, 3] {
            write_scene(&mut asked, &Scene::new(Camera::around([0.0; 3], 9.0, 0.0, 2, height))).unwrap();
        }
        // The last scene is torn: it has no answer.
        asked.pop();
        let draw = |scene: &Scene| match scene.camera.height {
            1 => Err(Error::BadValue { what: "the day", value: 1.0, must: "another" }),
            height => Ok(Image { width: 2, height, rgb: vec![7; 6 * height] }),
        };
        let mut said = Vec::new();
        serve(Ok(("a pencil".to_owned(), draw)), &mut &asked[..], &mut said).unwrap();
        let mut from = &said[..];
        assert!(matches!(read_answer(&mut from), Ok(Answer::Name(name)) if name == "a pencil"));
        assert!(matches!(read_answer(&mut from), Ok(Answer::Failed(why)) if why.contains("the day")));
        assert!(matches!(read_answer(&mut from), Ok(Answer::Picture(image)) if image.rgb == [7; 12]));
        assert!(from.is_empty());
    }

    #[test]
    fn a_program_that_cannot_draw_is_an_error_that_says_why() {
        let why = |command: Command| RenderProcess::start(command).unwrap_err().to_string();
        assert!(why(Command::new("there-is-no-such-program")).contains("does not start"));
        // A program that ends without a greeting: the compiler, saying its version to nobody.
        let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
        rustc.args(["--print", "sysroot", "--no-such-option"]).stderr(Stdio::null());
        assert!(why(rustc).contains("ended before it could draw"));
    }
}
