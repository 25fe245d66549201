//! Labels of a brick's voxels, and numbers for them such that labels which touch are one apart as often as may be: what borders by
//! two look-ups read (docs/rendering.md §8).

/// The labels of a block of voxels, numbered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// Label of each number.
    pub labels: Vec<u32>,
    /// Number of each voxel.
    pub numbers: Vec<u16>,
}

/// Finds each voxel's label, the look with the largest share of it (0 = background, else region + 1), from one region after the
/// other: of equal ones the first, the background last.
#[derive(Clone, Debug)]
pub struct Largest {
    labels: Vec<u32>,
    most: Vec<u8>,
    sums: Vec<u16>,
}

impl Largest {
    /// Of so many voxels.
    pub fn new(num_voxels: usize) -> Self {
        Self { labels: vec![0; num_voxels], most: vec![0; num_voxels], sums: vec![0; num_voxels] }
    }

    /// Takes the next look's memberships, voxel by voxel.
    pub fn take<'a>(&mut self, label: u32, memberships: impl Iterator<Item = &'a u8>) {
        let voxels = self.labels.iter_mut().zip(&mut self.most).zip(&mut self.sums);
        for (((own, most), sum), &f) in voxels.zip(memberships) {
            *sum = sum.saturating_add(u16::from(f));
            if f > *most {
                (*own, *most) = (label, f);
            }
        }
    }

    /// The labels.
    pub fn finish(mut self) -> Vec<u32> {
        for ((label, most), sum) in self.labels.iter_mut().zip(&self.most).zip(&self.sums) {
            if 255u16.saturating_sub(*sum) > u16::from(*most) {
                *label = 0;
            }
        }
        self.labels
    }
}

/// Numbers the labels of a cube of `edge`³ voxels, x fastest.
pub fn number(labels: &[u32], edge: usize) -> Numbered {
    let mut distinct = labels.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    let ranks: Vec<u16> = labels.iter().map(|l| distinct.partition_point(|d| d < l) as u16).collect();
    let order = path(distinct.len(), &touching(&ranks, edge));
    let mut number_of_rank = vec![0; distinct.len()];
    order.iter().zip(0..).for_each(|(rank, number)| number_of_rank[*rank] = number);
    Numbered {
        labels: order.iter().map(|rank| distinct[*rank]).collect(),
        numbers: ranks.iter().map(|rank| number_of_rank[usize::from(*rank)]).collect(),
    }
}

/// Pairs of numbers that voxels beside each other have, those with the most such voxels first, then the smaller ones.
fn touching(ranks: &[u16], edge: usize) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    for (axis, stride) in [1, edge, edge * edge].into_iter().enumerate() {
        for (i, &a) in ranks.iter().enumerate() {
            if i / edge.pow(axis as u32) % edge + 1 < edge {
                let b = ranks[i + stride];
                if a != b {
                    pairs.push([usize::from(a.min(b)), usize::from(a.max(b))]);
                }
            }
        }
    }
    pairs.sort_unstable();
    let mut counted: Vec<(usize, [usize; 2])> =
        pairs.chunk_by(|a, b| a == b).map(|alike| (alike.len(), alike[0])).collect();
    counted.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    counted.into_iter().map(|(_, pair)| pair).collect()
}

/// All of 0 … n − 1 one after the other, with as many of `pairs` beside each other as taking the first that still fit gives.
fn path(n: usize, pairs: &[[usize; 2]]) -> Vec<usize> {
    let mut beside: Vec<Vec<usize>> = vec![Vec::new(); n];
    // Which piece of the path each is in, by its root.
    let mut parent: Vec<usize> = (0..n).collect();
    let root = |parent: &[usize], mut i: usize| {
        while parent[i] != i {
            i = parent[i];
        }
        i
    };
    for &[a, b] in pairs {
        let (ra, rb) = (root(&parent, a), root(&parent, b));
        if ra != rb && beside[a].len() < 2 && beside[b].len() < 2 {
            beside[a].push(b);
            beside[b].push(a);
            parent[ra] = rb;
        }
    }
    let mut order = Vec::with_capacity(n);
    let mut is_done = vec![false; n];
    for first in 0..n {
        // The smaller end of a piece is met before its larger one.
        if is_done[first] || beside[first].len() == 2 {
            continue;
        }
        let mut next = Some(first);
        while let Some(at) = next {
            is_done[at] = true;
            order.push(at);
            next = beside[at].iter().copied().find(|b| !is_done[*b]);
        }
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_share_has_the_voxel() {
        let label = |memberships: &[u8]| {
            let mut largest = Largest::new(1);
            memberships.iter().zip(1..).for_each(|(f, label)| largest.take(label, std::iter::once(f)));
            largest.finish()[0]
        };
        for (memberships, expected) in [
            (&[][..], 0),
            (&[0, 0], 0),
            (&[127], 0),
            (&[128], 1),
            // A third each, the background's too: the first region.
            (&[85, 85], 1),
            (&[84, 85], 0),
            (&[200, 255, 255], 2),
            (&[255; 300], 1),
        ] {
            assert_eq!(label(memberships), expected, "{memberships:?}");
        }
    }

    #[test]
    fn labels_that_touch_most_are_one_apart() {
        // Layers across x of a cube of four voxels: 7 | 9 | 7 | 30.
        let cube: Vec<u32> = (0..64).map(|i| [7, 9, 7, 30][i % 4]).collect();
        let numbered = number(&cube, 4);
        assert_eq!(numbered.labels, [9, 7, 30]);
        assert_eq!(&numbered.numbers[..4], [1, 0, 1, 2]);
        assert!(cube.iter().zip(&numbered.numbers).all(|(l, n)| numbered.labels[usize::from(*n)] == *l));
        assert_eq!(number(&[5; 8], 2), Numbered { labels: vec![5], numbers: vec![0; 8] });
        // All different: a permutation, and more pairs than in any order given.
        let all: Vec<u32> = (0..1000).map(|i| i * 37 % 1000).collect();
        let numbered = number(&all, 10);
        let mut labels = numbered.labels;
        labels.sort_unstable();
        assert_eq!(labels, (0..1000).collect::<Vec<_>>());
    }

    #[test]
    fn pieces_of_a_path_follow_one_another_and_make_no_ring() {
        assert_eq!(path(4, &[[0, 1], [1, 2], [0, 2], [2, 3]]), [0, 1, 2, 3]);
        assert_eq!(path(5, &[[3, 4], [0, 4], [1, 2]]), [0, 4, 3, 1, 2]);
        assert_eq!(path(3, &[]), [0, 1, 2]);
    }
}
