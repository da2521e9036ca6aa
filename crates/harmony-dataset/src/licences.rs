//! What known licences allow.
//!
//! A table of facts for checks, no legal advice. A licence that is not in it must say by itself, in `sources.csv`,
//! whether the photo may be published.

/// A licence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "a row of a table of yes and no")]
pub struct Licence {
    /// Its name in `sources.csv`: SPDX where there is one.
    pub id: &'static str,
    /// Its text.
    pub url: &'static str,
    /// Whether copies may be published at all.
    pub redistributable: bool,
    /// Whether commerce is allowed.
    pub commercial: bool,
    /// Whether the author must be named.
    pub attribution: bool,
    /// Whether changed copies (blurred faces, textures in a scene) may be published.
    pub derivatives: bool,
}

const fn row(
    id: &'static str,
    url: &'static str,
    [redistributable, commercial, attribution, derivatives]: [bool; 4],
) -> Licence {
    Licence { id, url, redistributable, commercial, attribution, derivatives }
}

/// The table.
pub const KNOWN: [Licence; 13] = [
    row("CC0-1.0", "https://creativecommons.org/publicdomain/zero/1.0/", [true, true, false, true]),
    row("CC-BY-3.0", "https://creativecommons.org/licenses/by/3.0/", [true, true, true, true]),
    row("CC-BY-4.0", "https://creativecommons.org/licenses/by/4.0/", [true, true, true, true]),
    row("CC-BY-SA-4.0", "https://creativecommons.org/licenses/by-sa/4.0/", [true, true, true, true]),
    row("CC-BY-NC-4.0", "https://creativecommons.org/licenses/by-nc/4.0/", [true, false, true, true]),
    row("CC-BY-NC-SA-4.0", "https://creativecommons.org/licenses/by-nc-sa/4.0/", [true, false, true, true]),
    row("CC-BY-ND-4.0", "https://creativecommons.org/licenses/by-nd/4.0/", [true, true, true, false]),
    row("MIT", "https://spdx.org/licenses/MIT.html", [true, true, true, true]),
    row("Apache-2.0", "https://spdx.org/licenses/Apache-2.0.html", [true, true, true, true]),
    row("MIT OR Apache-2.0", "https://spdx.org/licenses/MIT.html", [true, true, true, true]),
    // Free use as part of a work, not as a collection of stock photos: the paper counts both as permissive.
    row("Pexels", "https://www.pexels.com/license/", [true, true, false, true]),
    row("Unsplash", "https://unsplash.com/license", [true, true, false, true]),
    // 3D-FRONT and 3D-FUTURE: for research, on request, not to be passed on.
    row("3D-FRONT-research", "https://tianchi.aliyun.com/dataset/65347", [false, false, true, false]),
];

/// A licence by its name, whatever its case.
pub fn find(id: &str) -> Option<&'static Licence> {
    KNOWN.iter().find(|l| l.id.eq_ignore_ascii_case(id.trim()))
}

/// Whether works under `part` may be in a data set that is published under `whole`; the reason if not.
pub fn conflict(part: &Licence, whole: &str) -> Option<&'static str> {
    let whole = find(whole)?;
    if !part.commercial && whole.commercial {
        return Some("it forbids commerce, the data set's licence allows it");
    }
    if part.id.contains("-SA-") && !whole.id.contains("-SA-") {
        return Some("it asks for the same licence for what is made from it");
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn licences_are_found_and_compared() {
        assert!(find("cc0-1.0").is_some_and(|l| !l.attribution));
        assert!(find("all rights reserved").is_none());
        let nc = find("CC-BY-NC-4.0").unwrap();
        assert!(conflict(nc, "CC-BY-4.0").is_some() && conflict(nc, "CC-BY-NC-4.0").is_none());
        assert!(conflict(find("CC-BY-SA-4.0").unwrap(), "CC-BY-NC-4.0").is_some());
        assert!(conflict(find("CC0-1.0").unwrap(), "CC-BY-4.0").is_none());
        let ids: std::collections::BTreeSet<_> = KNOWN.iter().map(|l| l.id).collect();
        assert_eq!(ids.len(), KNOWN.len());
    }
}
