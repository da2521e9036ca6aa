//! The table of models: hub name, files, pinned revision, checksum, size, licence.
//!
//! # Where the pins come from
//! No hub could be reached from where this table was written. Revisions, sizes and checksums of the hub's files were
//! read from public repositories that pin or check the same files, each checksum in several of them that are not
//! copies of one another (VGGT-1B-Commercial: in one); `docs/models.md` tells file by file. A wrong one can't do harm: the
//! file is refused. Checksums of torchvision's files begin with the eight digits that stand in their names. The heads
//! of LPIPS were hashed here.

/// Under what terms weights may be used.
#[derive(Debug, PartialEq, Eq)]
pub struct Licence {
    /// Name, as typed for `--accept-licence`.
    pub id: &'static str,
    /// Name in full.
    pub title: &'static str,
    /// What matters most, in a sentence or two; the text itself is what holds.
    pub terms: &'static str,
    /// Where the text is.
    pub address: &'static str,
    /// Whether use is restricted, so that somebody has to agree before the files are fetched or used.
    pub restricted: bool,
    /// Whether it is for non-commercial use only.
    pub non_commercial: bool,
}

/// Where a file comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A repository on the model hub.
    Hub {
        /// `owner/name`.
        repo: &'static str,
        /// Commit; `None` where none is known: the branch `main` at the first pull, that commit from then on.
        revision: Option<&'static str>,
    },
    /// PyTorch's own downloads.
    Torch,
    /// A file in a source repository.
    Code {
        /// `owner/name`.
        repo: &'static str,
        /// Commit.
        commit: &'static str,
    },
}

/// One file of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelFile {
    /// Its name in the model's folder.
    pub name: &'static str,
    /// Its path at the source.
    pub path: &'static str,
    /// Where it comes from.
    pub source: Source,
    /// Bytes, where known.
    pub size: Option<u64>,
    /// SHA-256 in small hexadecimal digits, where known.
    pub sha256: Option<&'static str>,
}

/// One model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// Name as typed, and of its folder.
    pub id: &'static str,
    /// What it is for.
    pub what: &'static str,
    /// Licence.
    pub licence: &'static Licence,
    /// Files.
    pub files: &'static [ModelFile],
    /// What else to know.
    pub note: &'static str,
}

impl Model {
    /// Bytes of all files whose size is known, and whether that is all of them.
    pub fn size(&self) -> (u64, bool) {
        (self.files.iter().filter_map(|f| f.size).sum(), self.files.iter().all(|f| f.size.is_some()))
    }

    /// Where it comes from, in words: the hub's name of it, or the repository.
    pub fn origin(&self) -> &'static str {
        match self.files.first().map(|f| f.source) {
            Some(Source::Hub { repo, .. } | Source::Code { repo, .. }) => repo,
            Some(Source::Torch) => "torchvision",
            None => "nowhere",
        }
    }

    /// The file of a name.
    pub fn file(&self, name: &str) -> Option<&'static ModelFile> {
        self.files.iter().find(|f| f.name == name)
    }
}

/// The model of a name.
pub fn find(id: &str) -> Option<&'static Model> {
    MODELS.iter().find(|m| m.id == id)
}

const CC_BY_NC: Licence = Licence {
    id: "cc-by-nc-4.0",
    title: "Creative Commons Attribution-NonCommercial 4.0",
    terms: "NON-COMMERCIAL USE ONLY; name the authors. For commercial work take vggt-1b-commercial instead.",
    address: "https://creativecommons.org/licenses/by-nc/4.0/legalcode",
    restricted: true,
    non_commercial: true,
};

const VGGT_LICENCE: Licence = Licence {
    id: "vggt-license-v1",
    title: "VGGT License v1 of 29 July 2025",
    terms: "Commercial use allowed; no military use; an acceptable-use policy is part of it. The hub asks for a form first.",
    address: "https://github.com/facebookresearch/vggt/blob/main/LICENSE.txt",
    restricted: true,
    non_commercial: false,
};

const APACHE: Licence = Licence {
    id: "apache-2.0",
    title: "Apache License 2.0",
    terms: "Free use; keep the notices.",
    address: "https://www.apache.org/licenses/LICENSE-2.0",
    restricted: false,
    non_commercial: false,
};

const MIT: Licence = Licence {
    id: "mit",
    title: "MIT",
    terms: "Free use; keep the notice. The model card advises against deployment without tests for the purpose at hand.",
    address: "https://github.com/openai/CLIP/blob/main/LICENSE",
    restricted: false,
    non_commercial: false,
};

const BSD: Licence = Licence {
    id: "bsd",
    title: "BSD (torchvision: 3 clauses; LPIPS: 2 clauses)",
    terms: "Free use; keep the notices. The trunk was trained on ImageNet, whose own terms its makers leave to you.",
    address: "https://github.com/pytorch/vision/blob/main/LICENSE",
    restricted: false,
    non_commercial: false,
};

const fn hub(
    repo: &'static str,
    revision: Option<&'static str>,
    name: &'static str,
    size: Option<u64>,
    sha256: Option<&'static str>,
) -> ModelFile {
    ModelFile { name, path: name, source: Source::Hub { repo, revision }, size, sha256 }
}

const fn sam2(
    repo: &'static str,
    revision: &'static str,
    name: &'static str,
    size: u64,
    sha256: &'static str,
) -> ModelFile {
    hub(repo, Some(revision), name, Some(size), Some(sha256))
}

const fn lpips_heads(name: &'static str, path: &'static str, size: u64, sha256: &'static str) -> ModelFile {
    let source =
        Source::Code { repo: "richzhang/PerceptualSimilarity", commit: "082bb24f84c091ea94de2867d34c4544f68e0963" };
    ModelFile { name, path, source, size: Some(size), sha256: Some(sha256) }
}

const fn torch(name: &'static str, size: u64, sha256: &'static str) -> ModelFile {
    ModelFile { name, path: name, source: Source::Torch, size: Some(size), sha256: Some(sha256) }
}

const OWLV2_BASE: &str = "google/owlv2-base-patch16-ensemble";
const OWLV2_BASE_REVISION: Option<&str> = Some("cfd3195ba4ea9592eec887ded089f4c08eff231d");
const OWLV2_LARGE: &str = "google/owlv2-large-patch14-ensemble";
const CLIP: &str = "openai/clip-vit-base-patch32";
const CLIP_REVISION: Option<&str> = Some("3d74acf9a28c67741b2f4f2ea7635f0aaf6f0268");

/// All models.
pub const MODELS: &[Model] = &[
    Model {
        id: "vggt-1b",
        what: "geometry: depth and camera of a photo",
        licence: &CC_BY_NC,
        files: &[hub(
            "facebook/VGGT-1B",
            Some("860abec7937da0a4c03c41d3c269c366e82abdf9"),
            "model.safetensors",
            Some(5_026_367_224),
            Some("f164acf60724910d8fe1578bb499d800850c7bb0948db7555c413f9fbe60467e"),
        )],
        note: "",
    },
    Model {
        id: "vggt-1b-commercial",
        what: "geometry: depth and camera of a photo",
        licence: &VGGT_LICENCE,
        files: &[hub(
            "facebook/VGGT-1B-Commercial",
            Some("ebb29a532abe92960eeb6903a5530f16990ef4ab"),
            "model.safetensors",
            Some(5_026_367_224),
            Some("2b766b284359bc47ce26be107254621f685b758a0282082ff109f3ff02788b53"),
        )],
        note: "gated: ask for access on the hub's page, then set HF_TOKEN",
    },
    Model {
        id: "sam2.1-tiny",
        what: "masks of objects",
        licence: &APACHE,
        files: &[sam2(
            "facebook/sam2.1-hiera-tiny",
            "de431c4043854a71d8101e17995dfe596bf101a5",
            "sam2.1_hiera_tiny.pt",
            156_008_466,
            "7402e0d864fa82708a20fbd15bc84245c2f26dff0eb43a4b5b93452deb34be69",
        )],
        note: "",
    },
    Model {
        id: "sam2.1-small",
        what: "masks of objects",
        licence: &APACHE,
        files: &[sam2(
            "facebook/sam2.1-hiera-small",
            "6c381d9c16faed5e8a7c4a2cd99918bdca8316e4",
            "sam2.1_hiera_small.pt",
            184_416_285,
            "6d1aa6f30de5c92224f8172114de081d104bbd23dd9dc5c58996f0cad5dc4d38",
        )],
        note: "",
    },
    Model {
        id: "sam2.1-base-plus",
        what: "masks of objects",
        licence: &APACHE,
        files: &[sam2(
            "facebook/sam2.1-hiera-base-plus",
            "b7320756a13354e7530a63935656d35b2f91a290",
            "sam2.1_hiera_base_plus.pt",
            323_606_802,
            "a2345aede8715ab1d5d31b4a509fb160c5a4af1970f199d9054ccfb746c004c5",
        )],
        note: "",
    },
    Model {
        id: "sam2.1-large",
        what: "masks of objects",
        licence: &APACHE,
        files: &[sam2(
            "facebook/sam2.1-hiera-large",
            "665f8e2ad61cf5f53d65644ff27c8ee525124610",
            "sam2.1_hiera_large.pt",
            898_083_611,
            "2647878d5dfa5098f2f8649825738a9345572bae2d4350a2468587ece47dd318",
        )],
        note: "",
    },
    Model {
        id: "owlv2-base",
        what: "boxes for phrases",
        licence: &APACHE,
        files: &[
            hub(
                OWLV2_BASE,
                OWLV2_BASE_REVISION,
                "model.safetensors",
                Some(619_918_824),
                Some("e1e130b9e404cf91a75ad45644c1da9d7fa5284085eecc864266a6923efb99e7"),
            ),
            hub(
                OWLV2_BASE,
                OWLV2_BASE_REVISION,
                "vocab.json",
                Some(1_059_962),
                Some("e089ad92ba36837a0d31433e555c8f45fe601ab5c221d4f607ded32d9f7a4349"),
            ),
            hub(
                OWLV2_BASE,
                OWLV2_BASE_REVISION,
                "merges.txt",
                Some(524_619),
                Some("9fd691f7c8039210e0fced15865466c65820d09b63988b0174bfe25de299051a"),
            ),
        ],
        note: "",
    },
    Model {
        id: "owlv2-large",
        what: "boxes for phrases",
        licence: &APACHE,
        files: &[
            hub(OWLV2_LARGE, None, "model.safetensors", None, None),
            hub(OWLV2_LARGE, None, "vocab.json", None, None),
            hub(OWLV2_LARGE, None, "merges.txt", None, None),
        ],
        note: "about 1.7 GB",
    },
    Model {
        id: "clip-vit-b32",
        what: "N-CLIP of `harmony bench`",
        licence: &MIT,
        files: &[hub(
            CLIP,
            CLIP_REVISION,
            "pytorch_model.bin",
            Some(605_247_071),
            Some("a63082132ba4f97a80bea76823f544493bffa8082296d62d71581a4feff1576f"),
        )],
        note: "",
    },
    Model {
        id: "lpips-alex",
        what: "LPIPS of `harmony bench`",
        licence: &BSD,
        files: &[
            torch(
                "alexnet-owt-7be5be79.pth",
                244_408_911,
                "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02",
            ),
            lpips_heads(
                "alex.pth",
                "lpips/weights/v0.1/alex.pth",
                6009,
                "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0",
            ),
        ],
        note: "",
    },
    Model {
        id: "lpips-vgg",
        what: "LPIPS with VGG-16",
        licence: &BSD,
        files: &[
            torch(
                "vgg16-397923af.pth",
                553_433_881,
                "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0",
            ),
            lpips_heads(
                "vgg.pth",
                "lpips/weights/v0.1/vgg.pth",
                7289,
                "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868",
            ),
        ],
        note: "",
    },
];

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn the_table_is_sound() {
        let hex = |text: &str, digits: usize| {
            assert!(text.len() == digits && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')), "{text}");
        };
        let ids: BTreeSet<&str> = MODELS.iter().map(|m| m.id).collect();
        assert_eq!(ids.len(), MODELS.len(), "every name once");
        for model in MODELS {
            assert!(!model.files.is_empty(), "{}", model.id);
            let plain = |name: &str| !name.is_empty() && !name.contains(['/', '\\']) && !name.starts_with('.');
            assert!(plain(model.id) && model.files.iter().all(|f| plain(f.name)), "{}: names are paths", model.id);
            for file in model.files {
                if let Some(sum) = file.sha256 {
                    hex(sum, 64);
                    assert!(file.size.is_some(), "{}: a checksum without a size", file.name);
                }
                if let Source::Hub { revision: Some(commit), .. } | Source::Code { commit, .. } = file.source {
                    hex(commit, 40);
                }
                // PyTorch writes the first digits of the checksum into the name.
                if let (Source::Torch, Some(sum)) = (file.source, file.sha256) {
                    assert!(file.name.contains(&sum[..8]), "{}", file.name);
                }
            }
            assert!(!model.licence.non_commercial || model.licence.restricted);
            assert!(!model.licence.non_commercial || model.licence.terms.contains("NON-COMMERCIAL"));
        }
    }
}
