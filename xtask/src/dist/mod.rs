//! `cargo xtask dist`: binary distributions: an archive, a Debian package, a Python wheel, a container image; and a software bill of
//! materials.
//!
//! ```text
//!  rotortwin-network ───────▶ stripped ─┬─▶ rotortwin-V-x86_64-linux.tar.gz   program, completions, manual pages
//!  lib_native.so ────────────▶ stripped ─┤─▶ rotortwin_V_amd64.deb             the same where Debian puts them
//!                                        │
//!  the C library of this system ──────────┼─▶ rotortwin-V-x86_64.oci.tar         a container image: see [`image`]
//!  clients/python ───────────▶ its wheel ─┴─▶ rotortwin-V-cp310-abi3-….whl      the command, the native module and the client
//!  cargo metadata ────────────────────────────▶ rotortwin-V-x86_64.cdx.json        what it is made of (CycloneDX)
//! ```
//! The minimum glibc version is that of the newest symbol used; it names the wheel and is the package's dependency.

mod image;
mod parts_list;

use crate::command;
use anyhow::{Context as _, Result, bail};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Version of the workspace, and of this package.
const VERSION: &str = env!("CARGO_PKG_VERSION");

const SHELLS: [(&str, &str); 3] = [
    ("bash", "usr/share/bash-completion/completions/rotortwin"),
    ("zsh", "usr/share/zsh/vendor-completions/_rotortwin"),
    ("fish", "usr/share/fish/vendor_completions.d/rotortwin.fish"),
];

/// How the program and the native module are compiled.
#[derive(Clone, Copy)]
pub(crate) enum Build {
    /// As `./run` and `./test` have it, and from what they have built.
    Ordinary,
    /// For size, with link-time optimisation, which compiles everything once more: docs/decisions/0055.
    Small,
}

impl Build {
    /// Its profile in Cargo.toml, and its folder in `target`.
    const fn profile(self) -> &'static str {
        match self {
            Self::Ordinary => "release",
            Self::Small => "small",
        }
    }
}

/// Builds all packages in `target/packages`.
pub(crate) fn run(root: &Path, build: Build) -> Result<()> {
    if matches!(build, Build::Small) {
        println!("-- compiles everything once more, in target/small: about 25 min on 2 idle cores");
    }
    command::build_as(root, build.profile(), &["--bin", "rotortwin-network", "--lib"])?;
    let built = root.join("target").join(build.profile());
    let out = root.join("target/packages");
    if out.exists() {
        fs::remove_dir_all(&out).with_context(|| format!("emptying {}", out.display()))?;
    }
    let stage = out.join("stage");
    fs::create_dir_all(&stage)?;
    // It supports every command: users need no second program.
    let program = stripped(&built.join("rotortwin-network"), &stage.join("rotortwin"))?;
    let module = stripped(&built.join("lib_native.so"), &stage.join("_native.abi3.so"))?;
    let glibc = newest_glibc(&program)?.max(newest_glibc(&module)?);
    let tree = installed(root, &program, &stage.join("root"))?;
    archive(root, &tree, &out)?;
    debian(&tree, &out, glibc)?;
    image::image(&program, &tree, &stage, &out)?;
    parts_list::write(root, &out)?;
    wheel(root, &program, &module, &out, glibc)?;
    fs::remove_dir_all(&stage)?;
    sums(&out)
}

/// Output of a command, which must succeed.
fn output_of(command: &mut Command) -> Result<String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let said = command.output().with_context(|| format!("starting {name}"))?;
    if !said.status.success() {
        bail!("{name}: {}", String::from_utf8_lossy(&said.stderr));
    }
    String::from_utf8(said.stdout).with_context(|| format!("what {name} prints"))
}

fn stripped(from: &Path, to: &Path) -> Result<PathBuf> {
    command::run(
        &format!("strip {}", from.display()),
        Command::new("strip").arg("-o").arg(to).arg(from),
    )?;
    Ok(to.to_owned())
}

/// The newest glibc version whose symbols are used.
fn newest_glibc(file: &Path) -> Result<(u32, u32)> {
    let said = Command::new("objdump")
        .arg("-T")
        .arg(file)
        .output()
        .context("starting objdump (binutils)")?;
    let text = String::from_utf8_lossy(&said.stdout);
    let versions = text.split("GLIBC_").skip(1).filter_map(|rest| {
        let end = rest
            .find(|c: char| !(c.is_ascii_digit() || c == '.'))
            .unwrap_or(rest.len());
        let (major, minor) = rest[..end].split_once('.')?;
        Some((major.parse().ok()?, minor.split('.').next()?.parse().ok()?))
    });
    versions
        .max()
        .with_context(|| format!("{} uses no glibc", file.display()))
}

/// The program, its completions and manual pages, relative to `/`.
fn installed(root: &Path, program: &Path, tree: &Path) -> Result<PathBuf> {
    let bin = tree.join("usr/bin");
    let manual = tree.join("usr/share/man/man1");
    let about = tree.join("usr/share/doc/rotortwin");
    for folder in [&bin, &manual, &about] {
        fs::create_dir_all(folder)?;
    }
    fs::copy(program, bin.join("rotortwin"))?;
    for (shell, place) in SHELLS {
        let said = Command::new(program).args(["completions", shell]).output()?;
        if !said.status.success() {
            bail!(
                "rotortwin completions {shell}: {}",
                String::from_utf8_lossy(&said.stderr)
            );
        }
        let place = tree.join(place);
        fs::create_dir_all(place.parent().context("a file lies in a folder")?)?;
        fs::write(place, said.stdout)?;
    }
    command::run(
        "manual pages",
        Command::new(program).args(["man", "--out"]).arg(&manual),
    )?;
    for name in ["README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"] {
        fs::copy(root.join(name), about.join(name))?;
    }
    fs::copy(
        root.join("deploy/foxglove/rotortwin.json"),
        about.join("foxglove-layout.json"),
    )?;
    fs::write(
        about.join("copyright"),
        "rotortwin: MIT or Apache-2.0, see LICENSE-MIT and LICENSE-APACHE beside this file.\n",
    )?;
    Ok(tree.to_owned())
}

fn archive(root: &Path, tree: &Path, out: &Path) -> Result<()> {
    let name = format!("rotortwin-{VERSION}-{}-linux", std::env::consts::ARCH);
    let mut tar = Command::new("tar");
    tar.current_dir(root)
        .args([
            "--create",
            "--gzip",
            "--sort=name",
            "--owner=0",
            "--group=0",
            "--numeric-owner",
        ])
        .arg(format!("--transform=s,^usr,{name},"))
        .arg("--file")
        .arg(out.join(format!("{name}.tar.gz")))
        .arg("--directory")
        .arg(tree)
        .arg("usr");
    command::run("archive", &mut tar)
}

fn debian(tree: &Path, out: &Path, (major, minor): (u32, u32)) -> Result<()> {
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        println!("-- no Debian package: there is no dpkg-deb here");
        return Ok(());
    }
    let architecture = match std::env::consts::ARCH {
        "x86_64" => "amd64",
        "aarch64" => "arm64",
        other => bail!("no name of Debian's for {other}"),
    };
    let control = tree.join("DEBIAN");
    fs::create_dir_all(&control)?;
    let text = format!(
        "Package: rotortwin\nVersion: {VERSION}\nArchitecture: {architecture}\nMaintainer: rotortwin\nSection: science\nPriority: optional\n\
         Depends: libc6 (>= {major}.{minor}), libgcc-s1\n\
         Description: co-simulation of multirotors with propeller faults, and a twin of measurements\n \
         Plant, controller and fault detection as processes in lockstep, a server for jobs,\n \
         and a model that is compared with flight logs.\n"
    );
    fs::write(control.join("control"), text)?;
    let file = out.join(format!("rotortwin_{VERSION}_{architecture}.deb"));
    let mut build = Command::new("dpkg-deb");
    build
        .args(["--root-owner-group", "-Zxz", "-z3", "--build"])
        .arg(tree)
        .arg(file);
    command::run("Debian package", &mut build)?;
    fs::remove_dir_all(control)?;
    Ok(())
}

/// The client's wheel with the native module, the command, and the name of the platform.
fn wheel(root: &Path, program: &Path, module: &Path, out: &Path, (major, minor): (u32, u32)) -> Result<()> {
    let stage = out.join("stage");
    let environment = root.join("target/dist-python");
    let python = environment.join("bin/python");
    if !environment.join("complete.txt").exists() {
        let mut make = Command::new("python3");
        command::run(
            "Python environment",
            make.args(["-m", "venv", "--clear"]).arg(&environment),
        )?;
        let mut install = Command::new(&python);
        command::run(
            "its packages",
            install.args(["-m", "pip", "install", "--quiet", "wheel>=0.42", "hatchling>=1.24"]),
        )?;
        fs::write(environment.join("complete.txt"), "")?;
    }
    let pure = stage.join("pure");
    let mut build = Command::new(&python);
    build.args([
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
    ]);
    command::run("wheel of the client", build.arg(&pure).arg(root.join("clients/python")))?;
    let file = fs::read_dir(&pure)?.next().context("pip made no wheel")??.path();
    let mut unpack = Command::new(&python);
    command::run(
        "unpack it",
        unpack.args(["-m", "wheel", "unpack", "--dest"]).arg(&stage).arg(file),
    )?;

    let folder = stage.join(format!("rotortwin-{VERSION}"));
    let scripts = folder.join(format!("rotortwin-{VERSION}.data/scripts"));
    fs::create_dir_all(&scripts)?;
    fs::copy(program, scripts.join("rotortwin"))?;
    fs::copy(module, folder.join("rotortwin/_native.abi3.so"))?;
    let about = folder.join(format!("rotortwin-{VERSION}.dist-info"));
    edit(
        &about.join("METADATA"),
        "Requires-Dist: httpx",
        "Requires-Dist: numpy>=1.24\nRequires-Dist: httpx",
    )?;
    let tag = format!("cp310-abi3-manylinux_{major}_{minor}_{}", std::env::consts::ARCH);
    edit(&about.join("WHEEL"), "Root-Is-Purelib: true", "Root-Is-Purelib: false")?;
    edit(&about.join("WHEEL"), "Tag: py3-none-any", &format!("Tag: {tag}"))?;
    let mut pack = Command::new(&python);
    command::run(
        "wheel of the platform",
        pack.args(["-m", "wheel", "pack", "--dest-dir"]).arg(out).arg(folder),
    )
}

/// Replaces the first occurrence of a text, which must exist.
fn edit(file: &Path, from: &str, to: &str) -> Result<()> {
    let text = fs::read_to_string(file)?;
    if !text.contains(from) {
        bail!("{}: expected '{from}'", file.display());
    }
    Ok(fs::write(file, text.replacen(from, to, 1))?)
}

/// Writes `SHA256SUMS`, and prints the files with their sizes.
fn sums(out: &Path) -> Result<()> {
    let mut names: Vec<String> = fs::read_dir(out)?
        .map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()))
        .collect::<Result<_>>()?;
    names.sort();
    let said = Command::new("sha256sum")
        .current_dir(out)
        .args(&names)
        .output()
        .context("starting sha256sum")?;
    fs::write(out.join("SHA256SUMS"), said.stdout)?;
    for name in names {
        let bytes = fs::metadata(out.join(&name))?.len();
        println!("{:>6.1} MB  target/packages/{name}", bytes as f64 / 1e6);
    }
    Ok(())
}
