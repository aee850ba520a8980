//! `cargo xtask convert`: grooms to `.hair` and meshes to `.obj`, in one stated unit.
//!
//! What a file is follows from its extension. A unit is never guessed: that of the input must be given, and the output
//! is in centimetres unless stated. Strands without length are refused unless asked to be left out.

use anyhow::{Context, bail};
use io_formats::groom::negate_axes;
use io_formats::{LengthUnit, read_groom, read_mesh, write_hair, write_obj};
use std::path::{Path, PathBuf};

/// Convert a groom (.hair, .tfx, .data, .ply) to .hair, or a mesh (.obj, .stl, .ply) to .obj.
#[derive(clap::Args)]
pub struct Args {
    /// File to read: .hair, .tfx, .data or .ply (groom), .obj, .stl or .ply (mesh).
    input: PathBuf,
    /// File to write: .hair for a groom, .obj for a mesh.
    output: PathBuf,
    /// Unit of the input: m, cm, mm, in, or centimetres per unit as a number.
    #[arg(long, value_name = "UNIT")]
    unit: String,
    /// Unit of the output, as for --unit.
    #[arg(long, value_name = "UNIT", default_value = "cm")]
    out_unit: String,
    /// Axes to negate, e.g. "z" or "xz"; a mirrored mesh keeps facing outwards.
    #[arg(long, value_name = "AXES", default_value = "")]
    negate: String,
    /// Points per strand, uniform by arc length; without it strands keep their own points.
    #[arg(long, value_name = "N")]
    resample: Option<usize>,
    /// Leave out strands without length or with points that are not numbers, instead of refusing the groom.
    #[arg(long)]
    drop_degenerate: bool,
}

/// Converts as asked and says what was written.
///
/// # Errors
/// A file that cannot be read, understood or written; a pair of extensions that makes no sense.
pub fn run(args: Args) -> anyhow::Result<()> {
    let unit: LengthUnit = args.unit.parse().context("--unit")?;
    let out_unit: LengthUnit = args.out_unit.parse().context("--out-unit")?;
    let axes = negate_axes(axes(&args.negate)?);
    match (extension(&args.input).as_str(), extension(&args.output).as_str()) {
        ("hair" | "tfx" | "data" | "ply", "hair") => convert_groom(&args, unit, out_unit, axes),
        ("obj" | "stl" | "ply", "obj") => convert_mesh(&args, unit, out_unit, axes),
        (from, to) => {
            bail!(
                "cannot turn .{from} into .{to}; grooms (.hair, .tfx, .data, .ply) become .hair, meshes (.obj, .stl, .ply) .obj"
            )
        }
    }
}

fn convert_groom(args: &Args, unit: LengthUnit, out_unit: LengthUnit, axes: [[f32; 3]; 3]) -> anyhow::Result<()> {
    let mut groom = read_groom(&args.input, unit)?;
    let dropped = if args.drop_degenerate { groom.drop_degenerate() } else { 0 };
    groom.validate().with_context(|| format!("checking {}", args.input.display()))?;
    let mut groom = groom.transformed(1.0, axes, [0.0; 3]);
    if let Some(n) = args.resample {
        groom = groom.resample(n).context("--resample")?.to_groom();
    }
    write_hair(&args.output, &groom, out_unit)?;
    println!(
        "{}: {} strands, {} points, {dropped} strands dropped",
        args.output.display(),
        groom.n_strands(),
        groom.points.len()
    );
    Ok(())
}

fn convert_mesh(args: &Args, unit: LengthUnit, out_unit: LengthUnit, axes: [[f32; 3]; 3]) -> anyhow::Result<()> {
    let mesh = read_mesh(&args.input, unit)?;
    let scale = (1.0 / out_unit.cm_per_unit()) as f32;
    let mesh = mesh.transformed(scale, axes, [0.0; 3]);
    write_obj(&args.output, &mesh)?;
    println!(
        "{}: {} vertices, {} triangles, {}",
        args.output.display(),
        mesh.vertices.len(),
        mesh.triangles.len(),
        if mesh.is_closed() { "closed" } else { "not closed: it cannot be used as a solid" }
    );
    Ok(())
}

fn axes(text: &str) -> anyhow::Result<[bool; 3]> {
    let mut negate = [false; 3];
    for axis in text.chars() {
        match "xyz".find(axis) {
            Some(k) => negate[k] = true,
            None => bail!("--negate {text:?}: {axis:?} is not one of x, y, z"),
        }
    }
    Ok(negate)
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(input: &Path, output: &Path, unit: &str, out_unit: &str, negate: &str) -> Args {
        Args {
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            unit: unit.to_owned(),
            out_unit: out_unit.to_owned(),
            negate: negate.to_owned(),
            resample: None,
            drop_degenerate: false,
        }
    }

    #[test]
    fn axes_are_named_once_each_in_any_order() {
        assert_eq!(axes("zx").unwrap(), [true, false, true]);
        assert_eq!(axes("").unwrap(), [false; 3]);
        assert!(axes("w").is_err());
    }

    #[test]
    fn a_mesh_mirrored_and_rescaled_twice_is_itself_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let text = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
        std::fs::write(path("a.obj"), text).unwrap();
        run(args(&path("a.obj"), &path("b.obj"), "cm", "mm", "z")).unwrap();
        run(args(&path("b.obj"), &path("c.obj"), "mm", "cm", "z")).unwrap();
        let mesh = |name: &str| read_mesh(&path(name), LengthUnit::Cm).unwrap();
        assert_eq!(mesh("c.obj"), mesh("a.obj"));
        assert_eq!(mesh("b.obj").vertices[3], [0.0, 0.0, -40.0]);
        assert!(mesh("b.obj").is_closed());
    }

    #[test]
    fn a_groom_does_not_become_a_mesh() {
        let error = run(args(Path::new("a.tfx"), Path::new("b.obj"), "m", "cm", "")).unwrap_err();
        assert!(error.to_string().contains("cannot turn .tfx into .obj"), "{error}");
    }
}
