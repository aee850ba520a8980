//! Animation caches other software opens: a streaming writer of ASCII USD layers (`.usda`).
//!
//! Hair becomes one `BasisCurves` prim of linear, non-periodic curves with time-sampled `points`; solids become `Mesh` prims
//! with a time-sampled transform. Samples of one attribute stand together in this format, so frames are asked for one after
//! the other and written at once: memory does not grow with their number. Points carry three decimals by default, ten
//! micrometres, which keeps 5,000 strands of 25 points at about 3 MB a frame. The layer states centimetres and y up.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use crate::envelope::{publish, temporary_path};
use crate::error::{Error, Result};
use crate::mesh::TriMesh;

/// Largest coordinate written (cm); with three decimals it still fits the digits of a double.
const MAX_COORDINATE: f64 = 1e9;

/// Most decimals a point may carry.
const MAX_DECIMALS: u8 = 6;

/// The layer's clock: frame `i` is time code `start + i`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsdaTiming {
    /// Frames per second, also the time codes per second.
    pub fps: f64,
    /// Time code of frame 0.
    pub start: i32,
    /// Number of frames.
    pub n_frames: usize,
}

/// How curves are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvesLook {
    /// Diameter of a strand (cm).
    pub width_cm: f32,
    /// Colour, linear RGB.
    pub color: [f32; 3],
    /// Decimals of a point's coordinates in cm, up to 6.
    pub decimals: u8,
}

impl CurvesLook {
    /// Brown hair 0.07 mm thick, points to ten micrometres.
    #[must_use]
    pub fn brown() -> Self {
        Self { width_cm: 0.007, color: [0.13, 0.07, 0.03], decimals: 3 }
    }
}

/// Writes one `.usda` layer, prim by prim.
#[derive(Debug)]
pub struct UsdaWriter {
    out: BufWriter<File>,
    temporary: PathBuf,
    path: PathBuf,
    timing: UsdaTiming,
    names: Vec<String>,
}

impl UsdaWriter {
    /// Starts a layer; it takes its name in [`UsdaWriter::finish`].
    ///
    /// # Errors
    /// When the rate or count of frames is not positive, or the file cannot be created.
    pub fn create(path: &Path, timing: UsdaTiming) -> Result<Self> {
        if !(timing.fps.is_finite() && timing.fps > 0.0) || timing.n_frames == 0 {
            let reason = format!("{} frames at {} a second", timing.n_frames, timing.fps);
            return Err(Error::CannotWrite { path: path.to_path_buf(), reason });
        }
        let temporary = temporary_path(path);
        let file = File::create(&temporary).map_err(Error::io("create", &temporary))?;
        let mut writer =
            Self { out: BufWriter::new(file), temporary, path: path.to_path_buf(), timing, names: Vec::new() };
        let last = i64::from(timing.start) + timing.n_frames as i64 - 1;
        writer.text(&format!(
            "#usda 1.0\n(\n    defaultPrim = \"World\"\n    endTimeCode = {last}\n    framesPerSecond = {fps}\n    \
             metersPerUnit = 0.01\n    startTimeCode = {start}\n    timeCodesPerSecond = {fps}\n    upAxis = \"Y\"\n)\n\n\
             def Xform \"World\"\n{{\n",
            fps = timing.fps,
            start = timing.start,
        ))?;
        Ok(writer)
    }

    /// Writes strands as `/World/<name>`. `fill(frame, points)` is called once per frame in order and sets all world
    /// positions (cm), strand after strand; `points` keeps what it held the frame before.
    ///
    /// # Errors
    /// When `fill` fails, a strand has no two points, a point is not finite, or the disk refuses.
    pub fn write_curves(
        &mut self,
        name: &str,
        point_counts: &[u32],
        look: CurvesLook,
        mut fill: impl FnMut(usize, &mut [[f32; 3]]) -> Result<()>,
    ) -> Result<()> {
        let name = self.new_name(name)?;
        if point_counts.is_empty() || point_counts.iter().any(|&n| n < 2) {
            return Err(self.refuse("curves need at least one strand, and two points in each".into()));
        }
        if look.decimals > MAX_DECIMALS || !look.width_cm.is_finite() || look.color.iter().any(|x| !x.is_finite()) {
            return Err(self.refuse(format!("{look:?} cannot be written")));
        }
        let n_points: usize = point_counts.iter().map(|&n| n as usize).sum();
        let [r, g, b] = look.color;
        self.text(&format!(
            "    def BasisCurves \"{name}\"\n    {{\n        uniform token type = \"linear\"\n        \
             uniform token wrap = \"nonperiodic\"\n        float[] widths = [{width}] (\n            \
             interpolation = \"constant\"\n        )\n        color3f[] primvars:displayColor = [({r}, {g}, {b})] (\n            \
             interpolation = \"constant\"\n        )\n",
            width = look.width_cm,
        ))?;
        let mut line = Vec::new();
        line.extend_from_slice(b"        int[] curveVertexCounts = [");
        push_list(&mut line, point_counts.iter(), |out, n| push_int(out, i64::from(*n)));
        line.extend_from_slice(b"]\n        point3f[] points.timeSamples = {\n");
        self.bytes(&line)?;

        let mut points = vec![[0.0_f32; 3]; n_points];
        let mut extents = Vec::with_capacity(self.timing.n_frames);
        for frame in 0..self.timing.n_frames {
            fill(frame, &mut points)?;
            let mut bounds = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            line.clear();
            self.push_time(&mut line, frame);
            line.push(b'[');
            for (i, p) in points.iter().enumerate() {
                if p.iter().any(|x| !x.is_finite() || f64::from(x.abs()) > MAX_COORDINATE) {
                    return Err(self.refuse(format!("frame {frame}, point {i} is {p:?}")));
                }
                for k in 0..3 {
                    bounds.0[k] = bounds.0[k].min(p[k]);
                    bounds.1[k] = bounds.1[k].max(p[k]);
                }
                if i > 0 {
                    line.push(b',');
                }
                push_point(&mut line, *p, look.decimals);
            }
            line.extend_from_slice(b"],\n");
            self.bytes(&line)?;
            extents.push(bounds);
        }
        line.clear();
        line.extend_from_slice(b"        }\n        float3[] extent.timeSamples = {\n");
        for (frame, (lo, hi)) in extents.iter().enumerate() {
            self.push_time(&mut line, frame);
            line.push(b'[');
            // Renderers cull by the extent, which has to hold the curves' thickness and what rounding moved.
            let margin = look.width_cm + 0.5 * 10.0_f32.powi(-i32::from(look.decimals));
            push_point(&mut line, lo.map(|x| x - margin), MAX_DECIMALS);
            line.push(b',');
            push_point(&mut line, hi.map(|x| x + margin), MAX_DECIMALS);
            line.extend_from_slice(b"],\n");
        }
        line.extend_from_slice(b"        }\n    }\n\n");
        self.bytes(&line)
    }

    /// Writes a solid as `/World/<name>`; `world_from_solid` has one pose (cm) per frame.
    ///
    /// # Errors
    /// When the number of poses is not that of the frames, something is not finite, or the disk refuses.
    pub fn write_mesh(&mut self, name: &str, mesh: &TriMesh, world_from_solid: &[Isometry3<f64>]) -> Result<()> {
        let name = self.new_name(name)?;
        mesh.validate(&self.path)?;
        if world_from_solid.len() != self.timing.n_frames {
            let reason = format!("{} poses for {} frames", world_from_solid.len(), self.timing.n_frames);
            return Err(self.refuse(reason));
        }
        let mut text = Vec::new();
        text.extend_from_slice(format!("    def Mesh \"{name}\"\n    {{\n").as_bytes());
        text.extend_from_slice(
            b"        uniform token subdivisionScheme = \"none\"\n        int[] faceVertexCounts = [",
        );
        push_list(&mut text, mesh.triangles.iter(), |out, _| out.push(b'3'));
        text.extend_from_slice(b"]\n        int[] faceVertexIndices = [");
        push_list(&mut text, mesh.triangles.iter().flatten(), |out, v| push_int(out, i64::from(*v)));
        text.extend_from_slice(b"]\n        point3f[] points = [");
        push_list(&mut text, mesh.vertices.iter(), |out, p| push_point(out, *p, MAX_DECIMALS));
        text.extend_from_slice(b"]\n");
        if let Some((lo, hi)) = mesh.bounds() {
            text.extend_from_slice(b"        float3[] extent = [");
            push_list(&mut text, [lo, hi].iter(), |out, p| push_point(out, *p, MAX_DECIMALS));
            text.extend_from_slice(b"]\n");
        }
        text.extend_from_slice(b"        matrix4d xformOp:transform.timeSamples = {\n");
        for (frame, pose) in world_from_solid.iter().enumerate() {
            let m = pose.to_homogeneous();
            if m.iter().any(|x| !x.is_finite()) {
                return Err(self.refuse(format!("pose of {name} in frame {frame} is not finite")));
            }
            self.push_time(&mut text, frame);
            text.push(b'(');
            // USD multiplies row vectors: its rows are our columns.
            let row = |c: usize| format!("({}, {}, {}, {})", m[(0, c)], m[(1, c)], m[(2, c)], m[(3, c)]);
            text.extend_from_slice((0..4).map(row).collect::<Vec<_>>().join(", ").as_bytes());
            text.extend_from_slice(b"),\n");
        }
        text.extend_from_slice(b"        }\n        uniform token[] xformOpOrder = [\"xformOp:transform\"]\n    }\n\n");
        self.bytes(&text)
    }

    /// Completes the layer, flushes it to disk and gives it its name.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn finish(mut self) -> Result<()> {
        self.text("}\n")?;
        let file = self.out.into_inner().map_err(|e| Error::io("write", &self.temporary)(e.into_error()))?;
        publish(file, &self.temporary, &self.path)
    }

    /// A prim name: letters, digits and underscores, unique in the layer.
    fn new_name(&mut self, name: &str) -> Result<String> {
        let mut clean: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if clean.is_empty() || clean.starts_with(|c: char| c.is_ascii_digit()) {
            clean.insert(0, '_');
        }
        if self.names.contains(&clean) {
            return Err(self.refuse(format!("two prims would be named {clean:?}")));
        }
        self.names.push(clean.clone());
        Ok(clean)
    }

    fn push_time(&self, out: &mut Vec<u8>, frame: usize) {
        out.extend_from_slice(b"            ");
        push_int(out, i64::from(self.timing.start) + frame as i64);
        out.extend_from_slice(b": ");
    }

    fn text(&mut self, text: &str) -> Result<()> {
        self.bytes(text.as_bytes())
    }

    fn bytes(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io("write", &self.temporary))
    }

    fn refuse(&self, reason: String) -> Error {
        Error::CannotWrite { path: self.path.clone(), reason }
    }
}

fn push_list<T>(out: &mut Vec<u8>, items: impl Iterator<Item = T>, push: impl Fn(&mut Vec<u8>, T)) {
    for (i, item) in items.enumerate() {
        if i > 0 {
            out.push(b',');
        }
        push(out, item);
    }
}

fn push_point(out: &mut Vec<u8>, p: [f32; 3], decimals: u8) {
    out.push(b'(');
    for (k, x) in p.into_iter().enumerate() {
        if k > 0 {
            out.push(b',');
        }
        push_decimal(out, f64::from(x), decimals);
    }
    out.push(b')');
}

/// `x` rounded to `decimals`, without trailing zeros; several times faster than formatting a float, which would dominate.
fn push_decimal(out: &mut Vec<u8>, x: f64, decimals: u8) {
    let power = 10_i64.pow(u32::from(decimals));
    let scaled = (x * power as f64).round() as i64;
    if scaled < 0 {
        out.push(b'-');
    }
    let magnitude = scaled.unsigned_abs();
    let (whole, mut fraction) = (magnitude / power as u64, magnitude % power as u64);
    push_digits(out, whole);
    if fraction == 0 {
        return;
    }
    out.push(b'.');
    let mut digit_value = power as u64 / 10;
    while fraction > 0 {
        out.push(b'0' + (fraction / digit_value) as u8);
        fraction %= digit_value;
        digit_value /= 10;
    }
}

fn push_int(out: &mut Vec<u8>, x: i64) {
    if x < 0 {
        out.push(b'-');
    }
    push_digits(out, x.unsigned_abs());
}

fn push_digits(out: &mut Vec<u8>, mut x: u64) {
    let mut digits = [0; 20];
    let mut n = 0;
    loop {
        digits[n] = b'0' + (x % 10) as u8;
        x /= 10;
        n += 1;
        if x == 0 {
            break;
        }
    }
    out.extend(digits[..n].iter().rev());
}
