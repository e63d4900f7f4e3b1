//! The modules of a crate and their dependencies within the crate.
//!
//! Derived from the tokens of its files: `use` declarations, and paths that begin with `crate`, `super`, `self` or the name of a
//! module. A re-exported name (`pub use`) is attributed to its origin. Code under `#[cfg(test)]` and the crate's tests, examples and
//! benches may use anything.

use super::graph::ModulePath;
use anyhow::{Context, Result, anyhow};
use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A module's tokens.
#[derive(Default)]
struct Module {
    /// The module whose file contains it: itself, or an enclosing one.
    file: ModulePath,
    children: BTreeSet<String>,
    /// Re-exported names, each with its path here.
    passed_on: BTreeMap<String, Vec<String>>,
    /// Every path that occurs in it.
    paths: BTreeSet<Vec<String>>,
}

type Modules = BTreeMap<ModulePath, Module>;

/// For each file of a crate, the files of the same crate that it uses.
pub(super) fn modules(folder: &Path) -> Result<BTreeMap<ModulePath, BTreeSet<ModulePath>>> {
    let source = folder.join("src");
    let root = ["lib.rs", "main.rs"]
        .map(|name| source.join(name))
        .into_iter()
        .find(|path| path.exists());
    let mut modules = Modules::new();
    read_file(
        &root.context("neither lib.rs nor main.rs")?,
        &source,
        &Vec::new(),
        &mut modules,
    )?;
    let mut uses: BTreeMap<ModulePath, BTreeSet<ModulePath>> = BTreeMap::new();
    for (place, module) in &modules {
        let used = uses.entry(module.file.clone()).or_default();
        for path in &module.paths {
            if let Some(owner) = resolve(&modules, place, path, 0) {
                used.insert(modules[&owner].file.clone());
            }
        }
    }
    Ok(uses)
}

/// Reads a file and the files of its modules, which are in `folder`.
fn read_file(file: &Path, folder: &Path, place: &ModulePath, modules: &mut Modules) -> Result<()> {
    let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let tokens: TokenStream = text.parse().map_err(|error| anyhow!("{}: {error}", file.display()))?;
    read_module(tokens, folder, place, place, modules)
}

/// Reads the tokens of a module: those of a file, or of `mod name { … }`.
fn read_module(
    tokens: TokenStream,
    folder: &Path,
    place: &ModulePath,
    file: &ModulePath,
    modules: &mut Modules,
) -> Result<()> {
    let mut reader = Reader::default();
    reader.read(tokens);
    let mut module = Module {
        file: file.clone(),
        passed_on: reader.passed_on,
        paths: reader.paths,
        ..Module::default()
    };
    for (name, content) in reader.modules {
        let child = [place.as_slice(), std::slice::from_ref(&name)].concat();
        let inner_folder = folder.join(&name);
        module.children.insert(name.clone());
        match content {
            Some(tokens) => read_module(tokens, &inner_folder, &child, file, modules)?,
            None => read_file(&file_of(folder, &name)?, &inner_folder, &child, modules)?,
        }
    }
    modules.insert(place.clone(), module);
    Ok(())
}

fn file_of(folder: &Path, name: &str) -> Result<PathBuf> {
    [folder.join(format!("{name}.rs")), folder.join(name).join("mod.rs")]
        .into_iter()
        .find(|path| path.exists())
        .with_context(|| format!("no file for module {name} in {}", folder.display()))
}

/// The module that owns a path; `None` if it is in another crate.
fn resolve(modules: &Modules, place: &ModulePath, path: &[String], depth: usize) -> Option<ModulePath> {
    let mut owner = place.clone();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => owner.clear(),
        "self" | "super" => {}
        name if modules[place].children.contains(name) => {}
        _ => return None,
    }
    while let Some(name) = rest.first() {
        let module = modules.get(&owner)?;
        match name.as_str() {
            "crate" | "self" => {}
            "super" => {
                owner.pop();
            }
            name if module.children.contains(name) => owner.push(name.to_owned()),
            name => {
                // A name from another crate belongs to the module that re-exports it.
                let passed_on = module.passed_on.get(name).filter(|_| depth < 8);
                let found =
                    passed_on.and_then(|path| resolve(modules, &owner, &[path, &rest[1..]].concat(), depth + 1));
                return Some(found.unwrap_or(owner));
            }
        }
        rest = &rest[1..];
    }
    Some(owner)
}

/// Results of walking the tokens of a module.
#[derive(Default)]
struct Reader {
    /// Declared modules; with tokens if they are in the same file.
    modules: Vec<(String, Option<TokenStream>)>,
    passed_on: BTreeMap<String, Vec<String>>,
    paths: BTreeSet<Vec<String>>,
}

impl Reader {
    fn read(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut at = 0;
        let mut is_public = false;
        while let Some(token) = tokens.get(at) {
            let previous_is_public = std::mem::take(&mut is_public);
            match token {
                // Test code, and modules with a file elsewhere (`#[path]`), are not rooms of this crate.
                TokenTree::Punct(hash)
                    if hash.as_char() == '#' && (is_cfg_test(tokens.get(at + 1)) || is_path(tokens.get(at + 1))) =>
                {
                    at = end_of_item(&tokens, at + 2);
                }
                TokenTree::Group(group) => {
                    // The parentheses of `pub(crate)`.
                    is_public = previous_is_public;
                    self.read(group.stream());
                    at += 1;
                }
                TokenTree::Ident(word) if word == "pub" => {
                    is_public = true;
                    at += 1;
                }
                TokenTree::Ident(word) if word == "mod" => at = self.read_mod(&tokens, at + 1),
                // Not the `use<…>` of a return type.
                TokenTree::Ident(word) if word == "use" && !is_punct(tokens.get(at + 1), '<') => {
                    let end = (at..tokens.len())
                        .find(|i| is_punct(tokens.get(*i), ';'))
                        .unwrap_or(tokens.len());
                    self.read_use(&[], &tokens[at + 1..end], previous_is_public);
                    at = end;
                }
                TokenTree::Ident(_) => {
                    let (path, end) = path_at(&tokens, at);
                    if path.len() > 1 {
                        self.paths.insert(path);
                    }
                    at = end;
                }
                TokenTree::Punct(_) | TokenTree::Literal(_) => at += 1,
            }
        }
    }

    /// `name;` or `name { … }` after `mod`.
    fn read_mod(&mut self, tokens: &[TokenTree], at: usize) -> usize {
        let content = match tokens.get(at + 1) {
            Some(TokenTree::Group(group)) => Some(group.stream()),
            _ => None,
        };
        if let Some(TokenTree::Ident(name)) = tokens.get(at) {
            self.modules.push((name.to_string(), content));
        }
        at + 2
    }

    /// A tree of a `use` declaration, below a path.
    fn read_use(&mut self, below: &[String], tokens: &[TokenTree], is_public: bool) {
        for tree in tokens.split(|token| is_punct(Some(token), ',')) {
            let (path, end) = path_at(tree, 0);
            let mut path = [below, &path].concat();
            if let Some(TokenTree::Group(group)) = tree.get(end) {
                let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                self.read_use(&path, &inner, is_public);
                continue;
            }
            if path.len() > 1 && path.last().is_some_and(|name| name == "self") {
                path.pop();
            }
            let name = match tree.last() {
                Some(TokenTree::Ident(name)) if end < tree.len() => Some(name.to_string()),
                _ => path.last().cloned(),
            };
            if let Some(name) = name.filter(|_| is_public) {
                self.passed_on.insert(name, path.clone());
            }
            self.paths.insert(path);
        }
    }
}

/// The path that starts at a word, and its end; includes a trailing `::`.
fn path_at(tokens: &[TokenTree], at: usize) -> (Vec<String>, usize) {
    let mut path = Vec::new();
    let mut at = at;
    while let Some(TokenTree::Ident(word)) = tokens.get(at) {
        path.push(word.to_string());
        at += 1;
        let colons =
            matches!(tokens.get(at), Some(TokenTree::Punct(p)) if p.as_char() == ':' && p.spacing() == Spacing::Joint);
        if !(colons && is_punct(tokens.get(at + 1), ':')) {
            break;
        }
        at += 2;
    }
    (path, at)
}

fn is_punct(token: Option<&TokenTree>, character: char) -> bool {
    matches!(token, Some(TokenTree::Punct(punct)) if punct.as_char() == character)
}

/// The brackets of `#[cfg(test)]`.
fn is_cfg_test(token: Option<&TokenTree>) -> bool {
    matches!(token, Some(TokenTree::Group(group)) if group.stream().to_string().replace(' ', "") == "cfg(test)")
}

fn is_path(token: Option<&TokenTree>) -> bool {
    matches!(token, Some(TokenTree::Group(group)) if group.stream().to_string().starts_with("path ="))
}

/// The end of the item that starts here: after its semicolon or its braces.
fn end_of_item(tokens: &[TokenTree], at: usize) -> usize {
    let ends = |token: &TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        other => is_punct(Some(other), ';'),
    };
    (at..tokens.len())
        .find(|i| ends(&tokens[*i]))
        .map_or(tokens.len(), |end| end + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The dependencies of a crate with these files, one `file -> file file` per line.
    fn uses(files: &[(&str, &str)]) -> Vec<String> {
        let folder = std::env::temp_dir().join(format!("rotortwin-rooms-{}-{}", std::process::id(), files.len()));
        for (name, text) in files {
            let path = folder.join("src").join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let modules = modules(&folder).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let name = |path: &ModulePath| path.join("::");
        modules
            .iter()
            .map(|(module, used)| {
                format!(
                    "{} -> {}",
                    name(module),
                    used.iter().map(name).collect::<Vec<_>>().join(" ")
                )
            })
            .collect()
    }

    #[test]
    fn val_names_lead_to_the_file_that_they_come_from() {
        let found = uses(&[
            (
                "lib.rs",
                "mod a; pub mod b; pub use b::inner::{Deep, Other as Named}; fn f() { a::g() }",
            ),
            (
                "a.rs",
                "use crate::Deep; fn g() -> impl Sized + use<> { crate::Named::new(); \"crate::b::x\" } // crate::b",
            ),
            (
                "b/mod.rs",
                "pub mod inner; pub mod side { use super::inner::Deep; use std::{fmt, io::{self, Read}}; }",
            ),
            (
                "b/inner.rs",
                "/// [`crate::a`]\npub struct Deep; #[cfg(test)] mod tests { use crate::a::g; } #[cfg(test)] use crate::a;",
            ),
        ]);
        assert_eq!(
            found,
            [" -> a b::inner", "a -> b::inner", "b -> b::inner", "b::inner -> "]
        );
    }

    #[test]
    fn val_paths_in_bodies_and_trees_count() {
        let found = uses(&[
            (
                "main.rs",
                "mod a; mod b; mod c; #[path = \"../e.rs\"] mod e; fn main() { if a::A::X > 1 { } }",
            ),
            ("a.rs", "use super::{b::{self, B}, c::*};"),
            ("b.rs", "fn f() { let x = Vec::<super::c::C>::new(); self::g(); }"),
            ("c.rs", "pub(in crate::c) struct C;"),
            ("d.rs", "not read"),
        ]);
        assert_eq!(found, [" -> a", "a -> b c", "b -> b c", "c -> c"]);
    }
}
