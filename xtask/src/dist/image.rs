//! A container image without a registry, a base image or a daemon: only what the program needs, as an OCI image layout in a tar.
//!
//! ```text
//!  oci-layout · index.json ─▶ manifest ─┬─▶ config: user, command, digest of the unpacked layer
//!  manifest.json (docker load)          └─▶ layer: /usr/bin/rotortwin, its C library, /etc/passwd, /data, /tmp
//! ```
//! Accepted by `podman load`, `skopeo copy oci-archive:FILE …` and `docker load`. Specification: OCI image format 1.0. The output is
//! reproducible: names are sorted, times are 0.

use super::{VERSION, output_of};
use crate::command;
use anyhow::{Context as _, Result, bail};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// User in the container, as in the `Dockerfile`.
const USER: &str = "10001:10001";

/// Writes the image.
///
/// * `tree`: installed files, relative to `/`   * `stage`: an empty working folder
pub(super) fn image(program: &Path, tree: &Path, stage: &Path, out: &Path) -> Result<()> {
    let root = stage.join("rootfs");
    fill(program, tree, &root)?;
    let layout = stage.join("layout");
    let blobs = layout.join("blobs/sha256");
    fs::create_dir_all(&blobs)?;

    let layer = stage.join("layer.tar");
    command::run("layer of the image", packed(&root, &layer).arg("."))?;
    let diff_id = sha256(&layer)?;
    command::run(
        "compress it",
        Command::new("gzip").args(["--no-name", "--force"]).arg(&layer),
    )?;
    let layer = Blob::take(
        &stage.join("layer.tar.gz"),
        &blobs,
        "application/vnd.oci.image.layer.v1.tar+gzip",
    )?;

    let architecture = match std::env::consts::ARCH {
        "x86_64" => "amd64",
        "aarch64" => "arm64",
        other => bail!("no name of an image for {other}"),
    };
    let config = json!({
        "architecture": architecture, "os": "linux",
        "config": {
            "User": USER, "WorkingDir": "/data", "Env": ["PATH=/usr/bin", "HOME=/data"], "ExposedPorts": { "8400/tcp": {} },
            "Entrypoint": ["/usr/bin/rotortwin"], "Cmd": ["serve", "--data", "/data"],
            "Labels": {
                "org.opencontainers.image.title": "rotortwin", "org.opencontainers.image.version": VERSION,
                "org.opencontainers.image.licenses": "MIT OR Apache-2.0",
            },
        },
        "rootfs": { "type": "layers", "diff_ids": [format!("sha256:{diff_id}")] },
        "history": [{ "created_by": "cargo xtask dist" }],
    });
    let config = Blob::write(&config, stage, &blobs, "application/vnd.oci.image.config.v1+json")?;
    let manifest = json!({
        "schemaVersion": 2, "mediaType": "application/vnd.oci.image.manifest.v1+json",
        "config": config.descriptor(), "layers": [layer.descriptor()],
    });
    let manifest = Blob::write(&manifest, stage, &blobs, "application/vnd.oci.image.manifest.v1+json")?;
    let name = format!("rotortwin:{VERSION}");
    let mut entry = manifest.descriptor();
    entry["platform"] = json!({ "architecture": architecture, "os": "linux" });
    entry["annotations"] = json!({ "org.opencontainers.image.ref.name": name });
    let index =
        json!({ "schemaVersion": 2, "mediaType": "application/vnd.oci.image.index.v1+json", "manifests": [entry] });
    let for_docker = json!([{ "Config": config.path(), "RepoTags": [name], "Layers": [layer.path()] }]);
    for (file, content) in [
        ("oci-layout", json!({ "imageLayoutVersion": "1.0.0" })),
        ("index.json", index),
        ("manifest.json", for_docker),
    ] {
        fs::write(layout.join(file), content.to_string())?;
    }
    let file = out.join(format!("rotortwin-{VERSION}-{}.oci.tar", std::env::consts::ARCH));
    let mut tar = packed(&layout, &file);
    command::run(
        "container image",
        tar.args(["oci-layout", "index.json", "manifest.json", "blobs"]),
    )
}

/// The files of the layer.
fn fill(program: &Path, tree: &Path, root: &Path) -> Result<()> {
    for folder in ["usr/bin", "usr/share/doc", "etc", "data", "tmp"] {
        fs::create_dir_all(root.join(folder))?;
    }
    fs::copy(program, root.join("usr/bin/rotortwin"))?;
    let about = Path::new("usr/share/doc/rotortwin");
    command::run(
        "papers of the image",
        Command::new("cp")
            .arg("-r")
            .arg(tree.join(about))
            .arg(root.join("usr/share/doc")),
    )?;
    fs::write(
        root.join("etc/passwd"),
        "root:x:0:0::/:/none\nrotortwin:x:10001:10001::/data:/none\n",
    )?;
    fs::write(root.join("etc/group"), "root:x:0:\nrotortwin:x:10001:\n")?;
    let said = output_of(Command::new("ldd").arg(program))?;
    let libraries: Vec<&Path> = said
        .split_whitespace()
        .filter(|word| word.starts_with('/'))
        .map(Path::new)
        .collect();
    if libraries.is_empty() {
        bail!("ldd {}: expected the C library, got '{said}'", program.display());
    }
    for library in libraries {
        let place = root.join(library.strip_prefix("/").context("an absolute path")?);
        fs::create_dir_all(place.parent().context("a file lies in a folder")?)?;
        fs::copy(library, place)?;
    }
    for package in ["libc6", "libgcc-s1"] {
        let licence = Path::new("/usr/share/doc").join(package).join("copyright");
        if licence.exists() {
            fs::copy(&licence, root.join(format!("usr/share/doc/{package}.copyright")))?;
        }
    }
    Ok(())
}

/// A reproducible tar of a folder. Folders that a process writes to belong to its user.
fn packed(folder: &Path, file: &Path) -> Command {
    let mut tar = Command::new("tar");
    tar.args([
        "--create",
        "--sort=name",
        "--mtime=@0",
        "--numeric-owner",
        "--format=ustar",
    ])
    .args(["--owner=10001", "--group=10001", "--mode=u+rwX,go+rX,go-w"])
    .arg("--file")
    .arg(file)
    .arg("--directory")
    .arg(folder);
    tar
}

/// A file named by its content hash.
struct Blob {
    digest: String,
    size: u64,
    media_type: &'static str,
}

impl Blob {
    fn take(file: &Path, blobs: &Path, media_type: &'static str) -> Result<Self> {
        let digest = sha256(file)?;
        let size = fs::metadata(file)?.len();
        fs::rename(file, blobs.join(&digest))?;
        Ok(Self {
            digest,
            size,
            media_type,
        })
    }

    fn write(content: &Value, stage: &Path, blobs: &Path, media_type: &'static str) -> Result<Self> {
        let file: PathBuf = stage.join("blob.json");
        fs::write(&file, content.to_string())?;
        Self::take(&file, blobs, media_type)
    }

    fn descriptor(&self) -> Value {
        json!({ "mediaType": self.media_type, "digest": format!("sha256:{}", self.digest), "size": self.size })
    }

    fn path(&self) -> String {
        format!("blobs/sha256/{}", self.digest)
    }
}

fn sha256(file: &Path) -> Result<String> {
    let said = output_of(Command::new("sha256sum").arg(file))?;
    let digest = said.split_whitespace().next().context("sha256sum said nothing")?;
    Ok(digest.trim_start_matches('\\').to_owned())
}
