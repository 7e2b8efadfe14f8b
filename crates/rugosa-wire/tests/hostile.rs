//! The checks of the fuzz targets, on their seeds and on random changes of them.

#[path = "common/hostile.rs"]
mod hostile;

use proptest::collection::vec;
use proptest::prelude::*;
use std::path::Path;

/// The seeds of a fuzz target; never none.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    let files = std::fs::read_dir(corpus.join(target)).unwrap();
    let seeds: Vec<_> = files
        .map(|f| std::fs::read(f.unwrap().path()).unwrap())
        .collect();
    assert!(!seeds.is_empty());
    seeds
}

#[test]
fn the_seeds_pass() {
    seeds("decoder")
        .iter()
        .for_each(|seed| hostile::decoder(seed));
    seeds("link").iter().for_each(|seed| hostile::link(seed));
}

/// Some bytes of the seed replaced, one after the other.
fn changed(mut seed: Vec<u8>, changes: &[(prop::sample::Index, u8)]) -> Vec<u8> {
    for (index, byte) in changes {
        let at = index.index(seed.len());
        seed[at] = *byte;
    }
    seed
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn changed_frames_pass(
        seed in prop::sample::select(seeds("decoder")),
        changes in vec(any::<(prop::sample::Index, u8)>(), 0..6),
    ) {
        hostile::decoder(&changed(seed, &changes));
    }

    #[test]
    fn changed_conversations_pass(
        seed in prop::sample::select(seeds("link")),
        times in 1usize..4,
        changes in vec(any::<(prop::sample::Index, u8)>(), 0..30),
    ) {
        hostile::link(&changed(seed.repeat(times), &changes));
    }

    #[test]
    fn any_conversation_passes(data in vec(any::<u8>(), 0..600)) {
        hostile::link(&data);
    }
}
