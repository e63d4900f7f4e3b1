//! Dependencies between rooms: cycles and layers.

use std::collections::{BTreeMap, BTreeSet};

/// Path of a module below its crate: `["effects", "wind"]`.
pub(super) type ModulePath = Vec<String>;

/// Rooms by name, each with its dependencies.
#[derive(Debug, Default)]
pub(super) struct Graph(pub(super) BTreeMap<String, BTreeSet<String>>);

impl Graph {
    /// Everything that a room uses, directly or through others.
    pub(super) fn reach(&self, room: &str) -> BTreeSet<&str> {
        let mut seen = BTreeSet::new();
        let mut open: Vec<&str> = self.used_by(room).collect();
        while let Some(next) = open.pop() {
            if seen.insert(next) {
                open.extend(self.used_by(next));
            }
        }
        seen
    }

    fn used_by(&self, room: &str) -> impl Iterator<Item = &str> {
        self.0.get(room).into_iter().flatten().map(String::as_str)
    }

    /// Rooms that depend on each other, directly or indirectly; each cycle in alphabetical order.
    pub(super) fn circles(&self) -> Vec<Vec<&str>> {
        self.groups().into_iter().filter(|group| group.len() > 1).collect()
    }

    /// All rooms, grouped by cycle.
    fn groups(&self) -> Vec<Vec<&str>> {
        let reach: BTreeMap<&str, BTreeSet<&str>> =
            self.0.keys().map(|room| (room.as_str(), self.reach(room))).collect();
        let mut groups: Vec<Vec<&str>> = Vec::new();
        for (room, reached) in &reach {
            let circle = groups.iter_mut().find(|group| {
                let first = group[0];
                reached.contains(first) && reach[first].contains(room)
            });
            match circle {
                Some(group) => group.push(room),
                None => groups.push(vec![room]),
            }
        }
        groups
    }

    /// Layers of rooms from the bottom up: each uses only rooms of lower layers. The rooms of a cycle share a layer.
    pub(super) fn floors(&self) -> Vec<Vec<Vec<&str>>> {
        let mut open = self.groups();
        let mut placed: BTreeSet<&str> = BTreeSet::new();
        let mut floors = Vec::new();
        while !open.is_empty() {
            // A cycle is in one group, so at least one group is always free.
            let (floor, rest): (Vec<_>, Vec<_>) = open.into_iter().partition(|group| {
                let mut used = group.iter().flat_map(|room| self.used_by(room));
                used.all(|room| placed.contains(room) || group.contains(&room) || !self.0.contains_key(room))
            });
            placed.extend(floor.iter().flatten());
            floors.push(floor);
            open = rest;
        }
        floors
    }

    /// Direct dependencies of a room, without those also implied by others; in an acyclic graph.
    pub(super) fn nearest(&self, room: &str) -> Vec<&str> {
        let indirect: BTreeSet<&str> = self.used_by(room).flat_map(|next| self.reach(next)).collect();
        self.used_by(room).filter(|next| !indirect.contains(next)).collect()
    }
}

/// The directories of a crate, each as a graph of its files and directories.
///
/// * `uses`: for each module that is a file, the modules that it uses
pub(super) fn by_directory(uses: &BTreeMap<ModulePath, BTreeSet<ModulePath>>) -> BTreeMap<ModulePath, Graph> {
    let mut directories: BTreeMap<ModulePath, Graph> = BTreeMap::new();
    for (module, used) in uses {
        for depth in 0..module.len() {
            let graph = directories.entry(module[..depth].to_vec()).or_default();
            let room = graph.0.entry(module[depth].clone()).or_default();
            room.extend(
                used.iter()
                    .filter(|other| {
                        other.len() > depth && other[..depth] == module[..depth] && other[depth] != module[depth]
                    })
                    .map(|other| other[depth].clone()),
            );
        }
    }
    directories
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(text: &str) -> ModulePath {
        text.split_terminator("::").map(str::to_owned).collect()
    }

    fn uses(rows: &[(&str, &[&str])]) -> BTreeMap<ModulePath, BTreeSet<ModulePath>> {
        rows.iter()
            .map(|(module, used)| (path(module), used.iter().map(|other| path(other)).collect()))
            .collect()
    }

    #[test]
    fn val_a_circle_between_directories_is_found_where_they_meet() {
        let uses = uses(&[
            ("", &["a"]),
            ("a", &["a::x"]),
            ("a::x", &["b::y", "a"]),
            ("b", &[]),
            ("b::y", &["a::z"]),
            ("a::z", &[]),
        ]);
        let directories = by_directory(&uses);
        assert_eq!(directories[&path("")].circles(), [["a", "b"]]);
        // A directory's own file and its contents may use each other.
        assert!(directories[&path("a")].circles().is_empty());
    }

    #[test]
    fn val_floors_and_nearest() {
        let uses = uses(&[
            ("top", &["left", "ground"]),
            ("left", &["right"]),
            ("right", &["left", "ground"]),
            ("ground", &[]),
        ]);
        let directories = by_directory(&uses);
        let graph = &directories[&path("")];
        let floors: [&[Vec<&str>]; 3] = [&[vec!["ground"]], &[vec!["left", "right"]], &[vec!["top"]]];
        assert_eq!(graph.floors(), floors);
    }

    #[test]
    fn val_what_follows_from_others_is_not_near() {
        let uses = uses(&[("top", &["left", "ground"]), ("left", &["ground"]), ("ground", &[])]);
        assert_eq!(by_directory(&uses)[&path("")].nearest("top"), ["left"]);
    }
}
