//! The modules of a Python package and their imports within the package.

use super::graph::Graph;
use anyhow::{Context, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The package's own file.
const OWN: &str = "__init__";

/// Reads all modules of a package without subpackages; `__init__` is the package's own file: a name imported from the package is from the
/// module that `__init__` imports it from.
///
/// Imports for type checkers only (`if TYPE_CHECKING:`) count like all others: readers follow them, too.
pub(super) fn modules(folder: &Path) -> Result<Graph> {
    let package = folder.file_name().and_then(|name| name.to_str());
    let package = package.context("a folder with the name of the package")?;
    let mut texts = BTreeMap::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if let Some(name) = path.file_name().and_then(|name| name.to_str()?.strip_suffix(".py")) {
            texts.insert(name.to_owned(), std::fs::read_to_string(&path)?);
        }
    }
    let passed_on: BTreeMap<String, String> = imports(texts.get(OWN).map_or("", String::as_str), package)
        .into_iter()
        .filter_map(|import| Some((import.alias?, import.module?)))
        .collect();
    let module_of = |import: Import| {
        let first = import.module.or(import.name)?;
        match texts.contains_key(&first) {
            true => Some(first),
            false => passed_on.get(&first).cloned(),
        }
    };
    let modules = texts.iter().filter(|(name, _)| *name != OWN).map(|(name, text)| {
        let used: BTreeSet<String> = imports(text, package).into_iter().filter_map(module_of).collect();
        (name.clone(), used)
    });
    Ok(Graph(modules.collect()))
}

/// One name that is imported from the package.
struct Import {
    /// The module it is imported from; `None` for the package itself.
    module: Option<String>,
    /// The name there; `None` where a module is imported under its whole name.
    name: Option<String>,
    /// The name here.
    alias: Option<String>,
}

/// Every import from the package in a text: `from .a import b`, `from . import a`, `from package import a`, `from package.a import b`,
/// `import package.a`.
fn imports(text: &str, package: &str) -> Vec<Import> {
    let below = |path: &str| Some(path.strip_prefix(package)?.strip_prefix('.')?.to_owned());
    let first = |path: String| path.split('.').next().map(str::to_owned);
    let mut found = Vec::new();
    for statement in statements(text) {
        let words = statement.split_whitespace().collect::<Vec<_>>().join(" ");
        if let Some(paths) = words.strip_prefix("import ") {
            let paths = paths.split(',').filter_map(|path| path.split_whitespace().next());
            found.extend(paths.filter_map(below).map(|path| Import {
                module: first(path),
                name: None,
                alias: None,
            }));
        }
        let Some((from, names)) = words.strip_prefix("from ").and_then(|rest| rest.split_once("import")) else {
            continue;
        };
        let module = match from.trim() {
            "." => None,
            own if own == package => None,
            other => match other.strip_prefix('.').map(str::to_owned).or_else(|| below(other)) {
                Some(path) => first(path),
                None => continue,
            },
        };
        for name in names.trim_matches([' ', '(', ')', ',']).split(',') {
            let mut words = name.split_whitespace().map(str::to_owned);
            let name = words.next();
            found.push(Import {
                module: module.clone(),
                alias: words.next_back().or_else(|| name.clone()),
                name,
            });
        }
    }
    found
}

/// The statements of a text without comments and strings; a statement in brackets is one.
fn statements(text: &str) -> Vec<String> {
    let (mut found, mut depth, mut rest) = (vec![String::new()], 0_usize, text);
    while let Some(character) = rest.chars().next() {
        let mut length = character.len_utf8();
        match character {
            '#' => length = rest.find('\n').unwrap_or(rest.len()),
            '"' | '\'' => length = string_length(rest, character),
            '\\' if rest[1..].starts_with('\n') => length = 2,
            '\n' | ';' if depth == 0 => found.push(String::new()),
            _ => {
                match character {
                    '(' | '[' | '{' => depth += 1,
                    ')' | ']' | '}' => depth = depth.saturating_sub(1),
                    _ => {}
                }
                found.last_mut().expect("there is a first statement").push(character);
            }
        }
        rest = &rest[length..];
    }
    found
}

/// Bytes of the string that a text starts with, its quotes included.
fn string_length(text: &str, quote: char) -> usize {
    let triple = quote.to_string().repeat(3);
    let end = match text.starts_with(&triple) {
        true => triple,
        false => quote.to_string(),
    };
    let mut at = end.len();
    while let Some(character) = text[at..].chars().next() {
        if text[at..].starts_with(&end) {
            return at + end.len();
        }
        at += character.len_utf8();
        if character == '\\' {
            at += text[at..].chars().next().map_or(0, char::len_utf8);
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The modules that a module with this text uses, in a package `p` with modules a, b and c, which passes on `Name` of c.
    ///
    /// * `test`: name of a folder of its own
    fn used(test: &str, text: &str) -> Vec<String> {
        let folder = std::env::temp_dir().join(format!("rotortwin-rooms-{test}-{}", std::process::id()));
        let package = folder.join("p");
        std::fs::create_dir_all(&package).unwrap();
        let own = "\"\"\"from .a import Example\"\"\"\nfrom .c import (\n    Name,\n    Other as Renamed,\n)\n";
        for (name, text) in [(OWN, own), ("a", ""), ("b", ""), ("c", ""), ("user", text)] {
            std::fs::write(package.join(format!("{name}.py")), text).unwrap();
        }
        let graph = modules(&package).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(!graph.0.contains_key(OWN));
        graph.0["user"].iter().cloned().collect()
    }

    #[test]
    fn val_every_form_of_an_import_within_a_package_is_seen() {
        for (text, expected) in [
            ("from .a import x", "a"),
            ("from . import a", "a"),
            ("from . import a as other, b  # both", "a b"),
            ("from . import (\n    a,\n    b,\n)", "a b"),
            ("from . import a, \\\n    b", "a b"),
            ("from p import a", "a"),
            ("from p.a import x", "a"),
            ("import p.a", "a"),
            ("import os, p.a as other, p.b", "a b"),
            ("def f():\n    from .a import x; from .b import y", "a b"),
            ("from p import Name", "c"),
            ("from . import Renamed", "c"),
            ("x = 'it\\'s'; from .a import x", "a"),
            ("x = '''\n'a'\n'''\nfrom .a import x", "a"),
        ] {
            assert_eq!(used("forms", text).join(" "), expected, "{text}");
        }
    }

    #[test]
    fn val_other_imports_are_none() {
        for text in [
            "import p",
            "import pa.a",
            "from pa import a",
            "from . import _native",
            "# from .a import x",
            "\"\"\"Example.\n\n    from p import a\n\"\"\"",
            "x = \"import p.a\"",
        ] {
            assert_eq!(used("others", text), [""; 0], "{text}");
        }
    }
}
