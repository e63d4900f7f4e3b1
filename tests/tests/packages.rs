//! Packages made by `cargo xtask dist`, installed where nothing of this checkout exists.

use rotortwin_tests::process::{load_per_core, wait_until};
use rotortwin_tests::program::PATIENCE;
use rotortwin_tests::python::{bytecode_folder, client_folder, environment, environment_of};
use rotortwin_tests::scratch::Scratch;
use rotortwin_tests::skip;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Goal from the beginning of an installation to the first verdict about a rotor.
const TO_THE_FIRST_VERDICT: Duration = Duration::from_secs(30);

/// Processes that are ready to run for each core, above which a time of the wall clock says nothing about a package.
const CROWDED: f64 = 2.0;

/// What the first flight after an installation must say.
const FIRST_VERDICT: &str = "rotor 3, lost";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// True if the small build is to be packed (`cargo xtask dist --small`), which a release has; else what `./test` has built is packed.
fn is_small() -> bool {
    std::env::var_os("ROTORTWIN_DIST").is_some_and(|build| build == "small")
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
            .args(is_small().then_some("--small"))
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

/// Prints the time from the beginning of an installation to the first verdict, which must not exceed the goal; on a crowded machine it is only printed.
fn first_verdict_after(what: &str, taken: Duration) {
    let load = load_per_core();
    println!(
        "{what}: {:.1} s from the beginning of the installation to the first verdict, load {load:.1} a core",
        taken.as_secs_f64()
    );
    assert!(
        taken <= TO_THE_FIRST_VERDICT || load > CROWDED,
        "{what}: {taken:?} from the beginning of the installation to the first verdict, expected at most {TO_THE_FIRST_VERDICT:?}"
    );
}

/// A server of an installed package, killed on drop.
struct Serving(Child);

impl Serving {
    /// Starts it with its data in a folder; also returns its address.
    fn start(program: &Path, folder: &Path) -> (Self, String) {
        let said = folder.join("said");
        let file = File::create(&said).expect("the folder can be written");
        let child = Command::new(program)
            .args(["serve", "--listen", "127.0.0.1:0", "--data"])
            .arg(folder.join("data"))
            .current_dir(folder)
            .env_remove("DATABASE_URL")
            .stdin(Stdio::null())
            .stdout(file.try_clone().expect("a file"))
            .stderr(file)
            .spawn();
        let serving = Self(child.expect("it starts"));
        let read = || std::fs::read_to_string(&said).expect("it was made");
        let url = || {
            let text = read();
            let line = text.lines().find_map(|line| line.strip_prefix("Serving"));
            line.map(|url| url.trim().to_owned())
        };
        wait_until(PATIENCE, || url().is_some()).unwrap_or_else(|| {
            panic!(
                "{} serve gave no address within {PATIENCE:?}: {}",
                program.display(),
                read()
            )
        });
        (serving, url().expect("it was there"))
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        if let Err(error) = self.0.kill().and_then(|()| self.0.wait().map(|_| ())) {
            eprintln!("the server cannot be killed: {error}");
        }
    }
}

/// Additional packages that the wheel's tests need.
const OF_THE_TESTS: [&str; 8] = [
    "httpx>=0.27,<1",
    "numpy>=1.24",
    "gymnasium>=1.1",
    "pandas>=2",
    "polars>=1",
    "pyarrow>=15",
    "matplotlib>=3.7",
    "pytest>=8",
];
/// Those that the notebook and the detectors of scikit-learn need as well.
const OF_ALL_TESTS: [&str; 3] = ["scikit-learn>=1.4", "nbclient>=0.10", "ipykernel>=6"];

/// Installs the wheel for an interpreter, in the environment of this name, and runs there what needs no server. `all`: also what depends on the interpreter least, the notebook,
/// the detectors of scikit-learn and long tests of the engine.
fn the_wheel_works(python: &str, name: &str, all: bool) {
    let Some(folder) = packages() else { return };
    let mut needed = OF_THE_TESTS.to_vec();
    needed.extend(OF_ALL_TESTS.into_iter().filter(|_| all));
    let Some(programs) = environment_of(python, &format!("wheel-{name}"), &needed) else {
        return;
    };
    let scratch = Scratch::new();
    let run = |program: &str, arguments: &[&std::ffi::OsStr], directory: &Path| {
        let output = Command::new(programs.join(program))
            .args(arguments)
            .current_dir(directory)
            .env("PYTHONPYCACHEPREFIX", bytecode_folder())
            .env("MPLBACKEND", "Agg")
            .env("ROTORTWIN_PROGRAM", programs.join("rotortwin"))
            .output()
            .expect("it starts");
        assert!(output.status.success(), "{program}: {}", words(&output));
        words(&output)
    };
    let begin = Instant::now();
    let wheel = package(folder, ".whl");
    let install = ["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"].map(std::ffi::OsStr::new);
    run(
        "python",
        &[&install[..], &[wheel.as_os_str()]].concat(),
        &scratch.path("."),
    );

    // The command, from a folder outside this checkout: flown, diagnosed, served.
    let command = |line: &str| {
        let words: Vec<&std::ffi::OsStr> = line.split(' ').map(std::ffi::OsStr::new).collect();
        run("rotortwin", &words, &scratch.path("."))
    };
    let flown = command("fly reference-flight");
    assert!(flown.contains("Run hash") && flown.contains(FIRST_VERDICT), "{flown}");
    // NumPy and the HTTP client, which `pip` would fetch from an index, were there.
    first_verdict_after(&format!("the wheel on {name}"), begin.elapsed());
    command("fly short-hover --out run");
    let found = command("diagnose run --model f550");
    assert!(found.contains("The model agrees"), "{found}");
    let (serving, url) = Serving::start(&programs.join("rotortwin"), scratch.folder());
    let flown = command(&format!("--server {url} fly short-hover"));
    assert!(flown.contains("Run hash"), "{flown}");
    drop(serving);
    // Its ten lines of Python.
    let example = client_folder().join("examples/damaged_blade.py");
    let said = run("python", &[example.as_os_str()], &scratch.path("."));
    assert!(said.contains("rotor 4 lost") && said.contains("named after"), "{said}");
    assert!(scratch.path("damaged-blade.png").is_file());

    let mut tests = ["-p", "no:cacheprovider", "tests/native"]
        .map(std::ffi::OsStr::new)
        .to_vec();
    if !all {
        tests.extend(["-m", "not of_the_engine"].map(std::ffi::OsStr::new));
    }
    print!("{name}: {}", run("pytest", &tests, &client_folder()));
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
    the_wheel_works("python3", "python3", true);
}

#[test]
fn scenario_the_wheel_works_on_the_oldest_and_a_newer_python() {
    for version in ["3.10", "3.13"] {
        match interpreter(version) {
            Some(python) => the_wheel_works(&python, &format!("python{version}"), false),
            None => skip(&format!("the wheel on python{version}: there is none here")),
        }
    }
}

/// An interpreter of this version: on the PATH, or one that pyenv has installed and not put there.
fn interpreter(version: &str) -> Option<String> {
    let name = format!("python{version}");
    let is_one = |python: &str| {
        let said = Command::new(python).arg("--version").output();
        said.is_ok_and(|said| said.status.success())
    };
    if is_one(&name) {
        return Some(name);
    }
    let home = std::env::var_os("PYENV_ROOT").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".pyenv")))?;
    let folders = std::fs::read_dir(home.join("versions")).ok()?.filter_map(Result::ok);
    folders
        .filter(|folder| folder.file_name().to_string_lossy().starts_with(&format!("{version}.")))
        .map(|folder| folder.path().join("bin").join(&name).to_string_lossy().into_owned())
        .find(|python| is_one(python))
}

/// Unpacks a package into a root file system with the C library and nothing else; there it flies, diagnoses and serves.
///
/// * `unpack`: shell that unpacks the package `$1` into the root `$2`
/// * `program`: the command below the root, as a pattern of the shell
fn works_in_an_empty_root(package: &Path, root: &Path, unpack: &str, program: &str) {
    let script = r#"
        set -e
        begin=$(date +%s%N)
        mkdir -p "$2"
        sh -ec "$3" unpack "$1" "$2"
        program=/$(cd "$2"; echo $4)
        mkdir -p "$2"/lib64 "$2"/lib "$2"/proc "$2"/dev "$2"/tmp "$2"/root
        for library in $(ldd "$2$program" | grep -o '/[^ ]*'); do mkdir -p "$2$(dirname "$library")"; cp -L "$library" "$2$library"; done
        exec unshare --mount --pid --fork sh -ec '
            root=$1 program=$2 begin=$3
            mount --rbind /dev "$root"/dev; mount -t proc proc "$root"/proc
            cd "$root"
            in_root() { HOME=/root TMPDIR=/tmp chroot "$root" "$program" "$@"; }
            in_root --version
            in_root fly reference-flight --out /tmp/first
            echo "First verdict: $(( ($(date +%s%N) - begin) / 1000000 )) ms"
            in_root fly short-hover --out /tmp/run
            in_root diagnose /tmp/run --model f550
            in_root serve --listen 127.0.0.1:0 --data /tmp/data > "$root"/tmp/said &
            for _ in $(seq 600); do url=$(sed -n "s/^Serving  *//p" "$root"/tmp/said); [ -z "$url" ] || break; sleep 0.1; done
            [ -n "$url" ] || { echo "the server gave no address within 60 s"; exit 1; }
            in_root --server "$url" fly short-hover
            echo "All done"
            kill %1; wait' sh "$2" "$program" "$begin"
    "#;
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .args([package, root])
        .args([unpack, program])
        .output()
        .expect("sh starts");
    let said = words(&output);
    assert!(said.contains("rotortwin 0.") && said.contains("All done"), "{said}");
    assert_eq!(said.matches("Run hash").count(), 3, "{said}");
    assert!(said.contains(FIRST_VERDICT), "{said}");
    assert!(said.contains("The model agrees"), "{said}");
    let name = package.file_name().expect("a file").to_string_lossy();
    first_verdict_after(&name, first_verdict_of(&said));
}

/// As the scripts print it.
fn first_verdict_of(said: &str) -> Duration {
    let taken_ms = said
        .lines()
        .find_map(|line| line.strip_prefix("First verdict: ")?.strip_suffix(" ms"))
        .and_then(|number| number.parse().ok());
    Duration::from_millis(taken_ms.unwrap_or_else(|| panic!("{said}")))
}

/// True if a package can be unpacked into a root of its own here; else a line says why not.
fn can_have_a_root(what: &str) -> bool {
    let can = rustix::process::geteuid().is_root() && Command::new("unshare").arg("--version").output().is_ok();
    if !can {
        skip(&format!("{what}: expected root and unshare"));
    }
    can
}

#[test]
fn scenario_the_debian_package_works_in_an_empty_root() {
    let Some(folder) = packages() else { return };
    if !can_have_a_root("the Debian package in an empty root") {
        return;
    }
    let scratch = Scratch::new();
    let root = scratch.path("root");
    works_in_an_empty_root(
        &package(folder, ".deb"),
        &root,
        r#"dpkg-deb -x "$1" "$2""#,
        "usr/bin/rotortwin",
    );
    for page in [
        "usr/share/man/man1/rotortwin-fly.1",
        "usr/share/bash-completion/completions/rotortwin",
    ] {
        assert!(root.join(page).is_file(), "{page}");
    }
}

/// As a user without a package manager would have it, in /opt.
#[test]
fn scenario_the_archive_works_in_an_empty_root() {
    let Some(folder) = packages() else { return };
    if !can_have_a_root("the archive in an empty root") {
        return;
    }
    let scratch = Scratch::new();
    let root = scratch.path("root");
    works_in_an_empty_root(
        &package(folder, "-linux.tar.gz"),
        &root,
        r#"mkdir "$2"/opt; tar --extract --file "$1" --directory "$2"/opt"#,
        "opt/rotortwin-*/bin/rotortwin",
    );
    let unpacked = package(&root.join("opt"), "-linux");
    for file in [
        "share/man/man1/rotortwin-fly.1",
        "share/bash-completion/completions/rotortwin",
        "share/doc/rotortwin/LICENSE-MIT",
    ] {
        assert!(unpacked.join(file).is_file(), "{file}");
    }
}

/// The page of figures gives the size of the program in the packages, of each build in a row.
#[test]
fn regress_the_size_of_the_program() {
    /// A version or two of growth, MB.
    const TOLERANCE_MB: f64 = 1.0;
    let Some(folder) = packages() else { return };
    let scratch = Scratch::new();
    let unpacked = Command::new("tar")
        .arg("--extract")
        .arg("--file")
        .arg(package(folder, "-linux.tar.gz"))
        .arg("--directory")
        .arg(scratch.folder())
        .output()
        .expect("tar starts");
    assert!(unpacked.status.success(), "{}", words(&unpacked));
    let program = package(scratch.folder(), "-linux").join("bin/rotortwin");
    let bytes = std::fs::metadata(&program).expect("the archive has it").len();
    let real_mb = f64::from(u32::try_from(bytes).expect("below 4 GB")) / 1e6;
    // The figure is that of x86-64.
    if std::env::consts::ARCH != "x86_64" {
        return skip(&format!(
            "the size of the program: the page has that of x86_64; here {real_mb:.1} MB"
        ));
    }
    let page = std::fs::read_to_string(root().join("docs/figures.md")).expect("it is there");
    let start = if is_small() {
        "| the program that the packages install"
    } else {
        "| – from the ordinary build"
    };
    let row = page
        .lines()
        .find(|line| line.starts_with(start))
        .unwrap_or_else(|| panic!("docs/figures.md: expected a row that starts with '{start}'"));
    let stated_mb: f64 = row
        .split('|')
        .nth(3)
        .and_then(|cell| cell.split(" MB").next()?.trim().parse().ok())
        .unwrap_or_else(|| panic!("docs/figures.md: expected the row's figure to begin with a number and MB: {row}"));
    assert!(
        (stated_mb - real_mb).abs() <= TOLERANCE_MB,
        "docs/figures.md states {stated_mb} MB, the program has {real_mb:.1} MB"
    );
}

/// The container image, unpacked by its own manifest: every blob matches its digest, and its command works as its user.
#[test]
fn scenario_the_container_image_works_without_a_daemon() {
    let Some(folder) = packages() else { return };
    if !can_have_a_root("the container image") {
        return;
    }
    let begin = Instant::now();
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
            root=$1; before=$2; user=$3; entry=$4; shift 4
            begin=$(date +%s%3N)
            mount --rbind /dev "$root"/dev; mount -t proc proc "$root"/proc
            rotortwin() { env -i HOME=/data PATH="$PATH" chroot --userspec="$user" "$root" "$entry" "$@"; }
            cd "$root"
            rotortwin fly reference-flight --out /data/first
            echo "First verdict: $(( before + $(date +%s%3N) - begin )) ms"
            rotortwin fly short-hover --out /data/run
            rotortwin diagnose /data/run --model f550
            rotortwin "$@" > "$root"/tmp/said &
            for _ in $(seq 600); do url=$(sed -n "s/^Serving  *//p" "$root"/tmp/said); [ -z "$url" ] || break; sleep 0.1; done
            [ -n "$url" ] || { echo "the server gave no address within 60 s"; exit 1; }
            rotortwin --server "$url" fly short-hover --out /data/run-2
            kill %1; wait' sh "$@"
    "#;
    let output = Command::new("sh")
        .args(["-c", script, "sh"])
        .arg(&root)
        .arg(begin.elapsed().as_millis().to_string())
        .arg(settings["User"].as_str().expect("a user"))
        .args(line("Entrypoint"))
        .args(line("Cmd"))
        .args(["--listen", "127.0.0.1:0"])
        .output()
        .expect("sh starts");
    let said = words(&output);
    assert_eq!(said.matches("Run hash").count(), 3, "{said}");
    assert!(
        said.contains(FIRST_VERDICT) && said.contains("The model agrees"),
        "{said}"
    );
    first_verdict_after("the container image, unpacked and checked", first_verdict_of(&said));
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
