//! Packages made by `cargo xtask dist`, installed where nothing of this checkout exists.

use rotortwin_tests::python::{client_folder, environment, environment_of};
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::skip;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The folder of the packages, made once. `None` if a tool is missing, which a line reports.
fn packages() -> Option<&'static Path> {
    static MADE: OnceLock<Option<PathBuf>> = OnceLock::new();
    MADE.get_or_init(|| {
        for (tool, package) in [("strip", "binutils"), ("objdump", "binutils"), ("dpkg-deb", "dpkg")] {
            if Command::new(tool).arg("--version").output().is_err() {
                skip(&format!("packages: {tool} is missing; expected Debian's {package}"));
                return None;
            }
        }
        // The Python that packs the wheel needs a package index; `dist` uses this one if it exists.
        environment("dist-python", &["wheel>=0.42", "hatchling>=1.24"])?;
        let mut dist = Command::new(env!("CARGO"));
        for (name, _) in std::env::vars_os() {
            // Cargo's variables for this test would cause libraries to be rebuilt.
            if name
                .to_str()
                .is_some_and(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_"))
            {
                dist.env_remove(name);
            }
        }
        let made = dist
            .current_dir(root())
            .args(["xtask", "dist"])
            .output()
            .expect("cargo starts");
        assert!(made.status.success(), "{}", words(&made));
        Some(root().join("target/packages"))
    })
    .as_deref()
}

fn words(output: &Output) -> String {
    [&output.stdout, &output.stderr]
        .map(|text| String::from_utf8_lossy(text).into_owned())
        .concat()
}

fn package(folder: &Path, ending: &str) -> PathBuf {
    let files = std::fs::read_dir(folder).expect("it is there");
    let mut names = files.map(|file| file.expect("a file").path());
    names
        .find(|name| name.to_string_lossy().ends_with(ending))
        .unwrap_or_else(|| panic!("{}: a file that ends in {ending}", folder.display()))
}

/// Additional packages that the wheel's tests need.
const OF_THE_TESTS: [&str; 11] = [
    "httpx>=0.27,<1",
    "numpy>=1.24",
    "gymnasium>=1.1",
    "pandas>=2",
    "polars>=1",
    "pyarrow>=15",
    "matplotlib>=3.7",
    "pytest>=8",
    "scikit-learn>=1.4",
    "nbclient>=0.10",
    "ipykernel>=6",
];

/// Installs the wheel for an interpreter and runs there what needs no server. `all`: also what depends on the interpreter least, the notebook
/// and the detectors of scikit-learn.
fn the_wheel_works(python: &str, all: bool) {
    let Some(folder) = packages() else { return };
    let Some(programs) = environment_of(python, &format!("wheel-{python}"), &OF_THE_TESTS) else {
        return;
    };
    let scratch = Scratch::new();
    let run = |program: &str, arguments: &[&std::ffi::OsStr], directory: &Path| {
        let output = Command::new(programs.join(program))
            .args(arguments)
            .current_dir(directory)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("MPLBACKEND", "Agg")
            .env("ROTORTWIN_PROGRAM", programs.join("rotortwin"))
            .output()
            .expect("it starts");
        assert!(output.status.success(), "{program}: {}", words(&output));
        words(&output)
    };
    let wheel = package(folder, ".whl");
    let install = ["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"].map(std::ffi::OsStr::new);
    run(
        "python",
        &[&install[..], &[wheel.as_os_str()]].concat(),
        &scratch.path("."),
    );

    // The command and its ten lines of Python, from a folder outside this checkout.
    let flown = run(
        "rotortwin",
        &["fly", "short-hover"].map(std::ffi::OsStr::new),
        &scratch.path("."),
    );
    assert!(flown.contains("Run hash"), "{flown}");
    let example = client_folder().join("examples/damaged_blade.py");
    let said = run("python", &[example.as_os_str()], &scratch.path("."));
    assert!(said.contains("rotor 4 lost") && said.contains("named after"), "{said}");
    assert!(scratch.path("damaged-blade.png").is_file());

    let tests = ["-p", "no:cacheprovider", "tests/native"].map(std::ffi::OsStr::new);
    print!("{python}: {}", run("pytest", &tests, &client_folder()));
    if !all {
        return;
    }
    // A custom detector, and the notebook, every cell of it.
    let example = client_folder().join("examples/own_detector.py");
    let said = run("python", &[example.as_os_str()], &scratch.path("."));
    assert!(
        said.contains("torque direction") && said.contains("boosted trees"),
        "{said}"
    );
    let notebook = client_folder().join("examples/first_flight.ipynb");
    let execute =
        "import sys, nbformat, nbclient; nbclient.NotebookClient(nbformat.read(sys.argv[1], 4), timeout=300).execute()";
    run(
        "python",
        &["-c".as_ref(), execute.as_ref(), notebook.as_os_str()],
        &scratch.path("."),
    );
}

#[test]
fn scenario_the_wheel_flies_and_diagnoses_without_a_server() {
    the_wheel_works("python3", true);
}

#[test]
fn scenario_the_wheel_works_on_the_oldest_and_a_newer_python() {
    for python in ["python3.10", "python3.13"] {
        if Command::new(python)
            .arg("--version")
            .output()
            .is_ok_and(|said| said.status.success())
        {
            the_wheel_works(python, false);
        } else {
            skip(&format!("the wheel on {python}: there is none here"));
        }
    }
}

/// A root file system with the package, the C library and nothing else.
#[test]
fn scenario_the_debian_package_works_in_an_empty_root() {
    let Some(folder) = packages() else { return };
    if !rustix::process::geteuid().is_root() || Command::new("unshare").arg("--version").output().is_err() {
        skip("the Debian package in an empty root: expected root and unshare");
        return;
    }
    let scratch = Scratch::new();
    let root = scratch.path("root");
    let script = r#"
        set -e
        dpkg-deb -x "$1" "$2"
        mkdir -p "$2"/lib64 "$2"/lib "$2"/proc "$2"/dev "$2"/tmp "$2"/root
        for library in $(ldd "$2"/usr/bin/rotortwin | grep -o '/[^ ]*'); do mkdir -p "$2$(dirname "$library")"; cp -L "$library" "$2$library"; done
        exec unshare --mount --pid --fork sh -ec '
            mount --rbind /dev "$1"/dev; mount -t proc proc "$1"/proc
            cd "$1"
            in_root() { HOME=/root TMPDIR=/tmp chroot "$root" /usr/bin/rotortwin "$@"; }
            root=$1
            in_root --version
            in_root fly short-hover --out /tmp/run
            in_root diagnose /tmp/run --model f550
            in_root serve --listen 127.0.0.1:0 --data /tmp/data > "$root"/tmp/said &
            for _ in $(seq 100); do url=$(sed -n "s/^Serving  *//p" "$root"/tmp/said); [ -z "$url" ] || break; sleep 0.1; done
            in_root --server "$url" fly short-hover
            kill %1; wait' sh "$2"
    "#;
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .args([package(folder, ".deb"), root.clone()])
        .output()
        .expect("sh starts");
    let said = words(&output);
    assert!(said.contains("rotortwin 0."), "{said}");
    assert_eq!(said.matches("Run hash").count(), 2, "{said}");
    assert!(said.contains("The model agrees"), "{said}");
    for page in [
        "usr/share/man/man1/rotortwin-fly.1",
        "usr/share/bash-completion/completions/rotortwin",
    ] {
        assert!(root.join(page).is_file(), "{page}");
    }
}

/// The container image, unpacked by its own manifest: every blob matches its digest, and its command works as its user.
#[test]
fn scenario_the_container_image_works_without_a_daemon() {
    let Some(folder) = packages() else { return };
    if !rustix::process::geteuid().is_root() || Command::new("unshare").arg("--version").output().is_err() {
        skip("the container image: expected root and unshare");
        return;
    }
    let scratch = Scratch::new();
    let (layout, root) = (scratch.path("layout"), scratch.path("root"));
    let unpack = |file: &Path, to: &Path| {
        std::fs::create_dir_all(to).expect("a folder");
        let tar = Command::new("tar")
            .args(["--extract", "--file"])
            .arg(file)
            .arg("--directory")
            .arg(to)
            .output();
        let tar = tar.expect("tar starts");
        assert!(tar.status.success(), "{}", words(&tar));
    };
    unpack(&package(folder, ".oci.tar"), &layout);
    let read = |path: PathBuf| rotortwin_tests::program::read_json(&path);
    let blob = |descriptor: &serde_json::Value| {
        let digest = descriptor["digest"]
            .as_str()
            .expect("a digest")
            .strip_prefix("sha256:")
            .expect("of SHA-256");
        let path = layout.join("blobs/sha256").join(digest);
        let size = std::fs::metadata(&path).expect("it is there").len();
        assert_eq!(descriptor["size"], size, "{}", path.display());
        let sum = Command::new("sha256sum").arg(&path).output().expect("sha256sum starts");
        assert!(words(&sum).starts_with(digest), "{}", path.display());
        path
    };
    assert_eq!(read(layout.join("oci-layout"))["imageLayoutVersion"], "1.0.0");
    let manifest = read(blob(&read(layout.join("index.json"))["manifests"][0]));
    let config = read(blob(&manifest["config"]));
    let layers = manifest["layers"].as_array().expect("layers");
    assert_eq!(
        layers.len(),
        config["rootfs"]["diff_ids"].as_array().expect("digests").len()
    );
    for (layer, diff_id) in layers
        .iter()
        .zip(config["rootfs"]["diff_ids"].as_array().expect("digests"))
    {
        let path = blob(layer);
        let plain = Command::new("sh")
            .args(["-c", "gzip -dc \"$1\" | sha256sum", "sh"])
            .arg(&path)
            .output();
        let plain = words(&plain.expect("sh starts"));
        assert!(
            diff_id
                .as_str()
                .is_some_and(|id| id.trim_start_matches("sha256:") == &plain[..64]),
            "{plain}"
        );
        unpack(&path, &root);
    }
    // For `docker load` of any version: the same blobs.
    let docker = read(layout.join("manifest.json"));
    assert_eq!(
        docker[0]["Layers"][0],
        format!(
            "blobs/{}",
            layers[0]["digest"].as_str().expect("a digest").replace(':', "/")
        )
    );

    let settings = &config["config"];
    let line = |key: &str| -> Vec<String> {
        let words = settings[key].as_array().expect("words").iter();
        words.map(|word| word.as_str().expect("a word").to_owned()).collect()
    };
    assert_eq!(line("Cmd"), ["serve", "--data", "/data"]);
    let script = r#"
        mkdir -p "$1"/proc "$1"/dev
        exec unshare --mount --pid --fork sh -ec '
            root=$1; user=$2; entry=$3; shift 3
            mount --rbind /dev "$root"/dev; mount -t proc proc "$root"/proc
            rotortwin() { env -i HOME=/data PATH="$PATH" chroot --userspec="$user" "$root" "$entry" "$@"; }
            cd "$root"
            rotortwin fly short-hover --out /data/run
            rotortwin "$@" > "$root"/tmp/said &
            for _ in $(seq 100); do url=$(sed -n "s/^Serving  *//p" "$root"/tmp/said); [ -z "$url" ] || break; sleep 0.1; done
            rotortwin --server "$url" fly short-hover --out /data/run-2
            kill %1; wait' sh "$@"
    "#;
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .arg(&root)
        .arg(settings["User"].as_str().expect("a user"))
        .args(line("Entrypoint"))
        .args(line("Cmd"))
        .args(["--listen", "127.0.0.1:0"])
        .output()
        .expect("sh starts");
    let said = words(&output);
    assert_eq!(said.matches("Run hash").count(), 2, "{said}");
}

#[test]
fn val_the_list_of_parts_names_what_is_in_the_packages() {
    let Some(folder) = packages() else { return };
    let list = rotortwin_tests::program::read_json(&package(folder, ".cdx.json"));
    assert_eq!(
        (&list["bomFormat"], &list["specVersion"]),
        (&"CycloneDX".into(), &"1.5".into())
    );
    let components = list["components"].as_array().expect("a list");
    let find = |name: &str| components.iter().find(|component| component["name"] == name);
    for linked in [
        "rotortwin-network",
        "rotortwin-native",
        "zenoh",
        "parquet",
        "tungstenite",
        "pyo3",
    ] {
        assert!(find(linked).is_some(), "{linked}");
    }
    for not in [
        "proptest",
        "prost-build",
        "serde_derive",
        "rotortwin-tests",
        "windows-sys",
    ] {
        assert!(find(not).is_none(), "{not}");
    }
    let zenoh = find("zenoh").expect("it is linked");
    assert_eq!(
        zenoh["hashes"][0]["content"].as_str().map(str::len),
        Some(64),
        "{zenoh}"
    );
    assert!(
        zenoh["licenses"][0]["expression"]
            .as_str()
            .is_some_and(|licence| licence.contains("Apache-2.0")),
        "{zenoh}"
    );
    // SHA256SUMS lists all files, including this one.
    let sums = std::fs::read_to_string(folder.join("SHA256SUMS")).expect("it was written");
    let files = std::fs::read_dir(folder).expect("it is there").count() - 1;
    assert_eq!(
        (sums.lines().count(), sums.contains(".cdx.json")),
        (files, true),
        "{sums}"
    );
}
