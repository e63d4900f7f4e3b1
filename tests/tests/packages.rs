//! What `cargo xtask dist` makes, installed where nothing of this checkout is.

use rotortwin_tests::python::{client_folder, environment, environment_of};
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::skip;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The folder of the packages, made once. `None`: something that makes them is not here, and a line says what.
fn packages() -> Option<&'static Path> {
    static MADE: OnceLock<Option<PathBuf>> = OnceLock::new();
    MADE.get_or_init(|| {
        for (tool, package) in [("strip", "binutils"), ("objdump", "binutils"), ("dpkg-deb", "dpkg")] {
            if Command::new(tool).arg("--version").output().is_err() {
                skip(&format!("packages: {tool} is missing; expected Debian's {package}"));
                return None;
            }
        }
        // The Python that packs the wheel needs a package index; it is the one that `dist` takes if it is there.
        environment("dist-python", &["wheel>=0.42", "hatchling>=1.24"])?;
        let mut dist = Command::new(env!("CARGO"));
        for (name, _) in std::env::vars_os() {
            // What cargo says of this test would have libraries built again.
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

/// What the wheel's tests need besides it.
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

/// Installs the wheel for an interpreter and runs in it what needs no server.
fn the_wheel_works(python: &str) {
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

    // The command and its ten lines of Python, from a folder that knows nothing of this checkout.
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

    // A detector of one's own, and the notebook, every cell of it.
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

    let tests = ["-p", "no:cacheprovider", "tests/native"].map(std::ffi::OsStr::new);
    print!("{python}: {}", run("pytest", &tests, &client_folder()));
}

#[test]
fn scenario_the_wheel_flies_and_diagnoses_without_a_server() {
    the_wheel_works("python3");
}

#[test]
fn scenario_the_wheel_works_on_the_oldest_and_a_newer_python() {
    for python in ["python3.10", "python3.13"] {
        if Command::new(python)
            .arg("--version")
            .output()
            .is_ok_and(|said| said.status.success())
        {
            the_wheel_works(python);
        } else {
            skip(&format!("the wheel on {python}: there is none here"));
        }
    }
}

/// A root that holds the package, the C library and nothing else.
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
