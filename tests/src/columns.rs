//! Display width of terminal lines.

/// Lines that are wider than `width`, but for those that only a path, an address or a hash makes so: these are never broken.
pub fn too_wide(text: &str, width: usize) -> Vec<&str> {
    text.lines()
        .filter(|line| line.chars().count() > width && !is_excused(line, width))
        .collect()
}

/// A word that fills most of a line is of a kind that is never broken, and the rest of the line would fit.
fn is_excused(line: &str, width: usize) -> bool {
    /// Label or indent before what cannot be broken.
    const BEFORE: usize = 20;
    let (whole, rest): (Vec<&str>, Vec<&str>) = line.split_whitespace().partition(|word| is_whole(word));
    let letters = |word: &&str| word.chars().count();
    let others: usize = rest.iter().map(|word| letters(word) + 1).sum();
    whole.iter().any(|word| letters(word) + BEFORE >= width) && others <= width
}

/// A path, an address of the web, or a hash.
fn is_whole(word: &str) -> bool {
    let word = word.trim_matches(|letter: char| matches!(letter, '(' | ')' | ',' | ';' | ':' | '.' | '\''));
    let is_hash = word.len() >= 16 && word.chars().all(|letter| letter.is_ascii_hexdigit());
    is_hash || word.contains('/')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_only_paths_addresses_and_hashes_may_be_wider() {
        let path = format!("/tmp/{}", "folder/".repeat(11));
        let hash = "0123456789abcdef".repeat(5);
        for line in [
            format!("Files        {path}"),
            format!("Run hash     {hash}"),
            format!("{path}: no run here"),
            "short".to_owned(),
        ] {
            assert_eq!(too_wide(&line, 80), Vec::<&str>::new(), "{line}");
        }
        let sentence = "a sentence of words that nobody has broken ".repeat(3);
        for line in [
            sentence.clone(),
            // It was forgiven for its one long word.
            format!("{sentence}{path}"),
            "x".repeat(81),
            "─".repeat(217),
            format!("{} a/b", "word ".repeat(17)),
        ] {
            assert_eq!(too_wide(&line, 80), [line.as_str()], "{line}");
        }
    }
}
