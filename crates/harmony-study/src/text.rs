//! What participants read.
//!
//! Paper: appendix "User Study", "The interface instructions read verbatim". With 20 scenes and six methods
//! [`instructions`] is that text word by word; other numbers replace its numbers and nothing else.

/// The paper's instructions for so many trials and panels.
pub fn instructions(trials: usize, panels: usize) -> String {
    let word = number(panels);
    let last = letter(panels.saturating_sub(1));
    format!(
        "You'll see {trials} real room photos. For each, {word} reconstructions (A to {last}, shown in random order) \
         attempt to recreate the scene. Rank all {word} by how well they match the input photo perceptually (geometry, \
         objects, layout, realism): give each a distinct rank from 1 = best to {panels} = worst. Clicking a rank \
         that's already used moves it to the current one, so every rank ends up used exactly once."
    )
}

/// A consent text to start from; a lab puts its own in its place.
pub fn consent(trials: usize, minutes: usize, contact: Option<&str>) -> String {
    let contact = contact.map_or_else(
        || "the person who sent you this page".to_owned(),
        |c| format!("{c} (the person responsible for this study)"),
    );
    format!(
        "This study asks how well computer-made 3D rooms match photographs. You will rank pictures in {trials} trials; \
         that takes about {minutes} minutes, and you can pause and come back.\n\
         Taking part is voluntary. You may stop at any time by closing the page, without giving a reason.\n\
         What is stored: the random code of this session, your ranks, and for each trial how long it took, how often \
         you changed a rank or zoomed, and whether the page showed one column or a grid. No name, no address, no \
         network address, no clock time. The ranks may be published without the codes.\n\
         To have your answers deleted, send your code to {contact}."
    )
}

/// Minutes that a study takes, at 50 seconds a trial.
pub fn minutes(trials: usize) -> usize {
    (trials * 50).div_ceil(60).max(1)
}

/// The letter of a panel.
pub fn letter(panel: usize) -> char {
    char::from(b'A' + panel.min(25) as u8)
}

fn number(n: usize) -> String {
    ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"]
        .get(n)
        .map_or_else(|| n.to_string(), |w| (*w).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_study_has_the_papers_words() {
        // Appendix "User Study", with its line breaks as blanks.
        let paper = "You'll see 20 real room photos. For each, six reconstructions (A to F, shown in random order) \
            attempt to recreate the scene. Rank all six by how well they match the input photo perceptually (geometry, \
            objects, layout, realism): give each a distinct rank from 1 = best to 6 = worst. Clicking a rank that's \
            already used moves it to the current one, so every rank ends up used exactly once.";
        assert_eq!(instructions(20, 6), paper);
        let three = instructions(5, 3);
        assert!(
            three.contains("5 real room photos. For each, three reconstructions (A to C,")
                && three.contains("3 = worst")
        );
    }
}
