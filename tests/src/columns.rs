//! How wide the lines of a terminal are.

/// Lines that are wider than `width`, but for words that cannot be broken, such as paths.
pub fn too_wide(text: &str, width: usize) -> Vec<&str> {
    let breakable = |line: &&str| {
        let widest = line
            .split_whitespace()
            .map(|word| word.chars().count())
            .max()
            .unwrap_or(0);
        widest + 20 < width
    };
    text.lines()
        .filter(|line| line.chars().count() > width)
        .filter(breakable)
        .collect()
}
