//! Narrow strips, as the edge of a door: what lies beside them hides one end of a chance gap from
//! the other.

use super::context::Context;
use super::growth::NOBODY;
use super::merging::Freedom;
use super::pieces::{gap, spacing};
use super::regions::{Competition, Members, Region};
use super::roughness::Surfaces;
use crate::neighbors::Search;
use crate::{Error, Workers};

/// The labels with parts of a narrow strip put together where they are one plane by the price of
/// merging and the gap between them is one that chance leaves. On rough surfaces nothing is: where
/// errors are alike over more than the width of a strip, it tells no plane.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn join_strips(
    context: &Context,
    labels: &[i32],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let &Context { tree, graph, surfaces, settings, .. } = context;
    if surfaces == Surfaces::Rough {
        return Ok(labels.to_vec());
    }
    let points = tree.points();
    let regions = &context.fit(labels, workers)[..];
    let mut members = Members::of(labels);
    let mut narrow: Vec<u32> = Vec::new();
    for (k, region) in regions.iter().enumerate() {
        let places = members.get(k);
        let width = (12.0 * region.spread().variances[1]).sqrt();
        let spacing = spacing(points, graph, labels, places.iter().copied());
        let most = (places.len() as f64).ln() + settings.gaps.chance;
        if settings.gaps.unbridged * (width / spacing + 1.0) < most {
            narrow.extend(places);
        }
    }
    narrow.sort_unstable();
    let labels = &taken(context, regions, labels, &mut narrow, workers)?;
    let mut ends: Vec<Vec<([i32; 2], [u32; 2])>> = vec![Vec::new(); narrow.len()];
    workers.fill(&mut ends, 1, Search::default, |search, k, ends| {
        let place = narrow[k];
        let own = labels[place as usize];
        for near in tree.nearest(&points[place as usize], settings.gaps.looked_at, search) {
            let other = labels[near.place as usize];
            if other != own && other != NOBODY {
                ends[0].push(if own < other {
                    ([own, other], [place, near.place])
                } else {
                    ([other, own], [near.place, place])
                });
            }
        }
    })?;
    let mut bridges = ends.concat();
    bridges.sort_unstable();
    bridges.dedup();
    members = Members::of(labels);
    let freedom = Freedom::of(surfaces, regions, settings);
    let mut first: Vec<i32> = (0..members.len() as i32).collect();
    for bridges in bridges.chunk_by(|one, other| one.0 == other.0) {
        let pair = bridges[0].0.map(|label| label as usize);
        if freedom.allows(pair.map(|label| &regions[label]))
            && gap(points, graph, labels, bridges, pair.map(|k| members.get(k)))
                .is_chance(settings.gaps.chance)
        {
            let [a, b] = pair.map(|label| first[label]);
            for end in first.iter_mut().filter(|end| **end == a.max(b)) {
                *end = a.min(b);
            }
        }
    }
    let of = |&label: &i32| if label == NOBODY { NOBODY } else { first[label as usize] };
    Ok(labels.iter().map(of).collect())
}

/// The labels with points of no plane given to the likeliest one around them, where a strip is
/// among these: short parts between two gaps had nothing that they touch. They join the strips' points.
fn taken(
    context: &Context,
    regions: &[Region],
    labels: &[i32],
    narrow: &mut Vec<u32>,
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let &Context { tree, graph, surfaces, settings, .. } = context;
    let points = tree.points();
    let competition = Competition::new(regions, surfaces, settings, settings.gaps.looked_at);
    let mut labels = labels.to_vec();
    let mut rim = narrow.clone();
    while !rim.is_empty() {
        let mut free: Vec<Vec<u32>> = vec![Vec::new(); rim.len()];
        workers.fill(&mut free, 1, Search::default, |search, k, free| {
            let near = tree.nearest(&points[rim[k] as usize], settings.gaps.looked_at, search);
            let near = near.iter().map(|near| near.place);
            free[0].extend(near.filter(|&place| labels[place as usize] == NOBODY));
        })?;
        let mut free = free.concat();
        free.sort_unstable();
        free.dedup();
        let mut best = vec![NOBODY; free.len()];
        workers.fill(
            &mut best,
            1,
            || (Search::default(), Vec::new()),
            |(search, counts), k, best| {
                let place = free[k] as usize;
                let near = tree.nearest(&points[place], settings.gaps.looked_at, search);
                let around = near.iter().map(|near| labels[near.place as usize]);
                best[0] =
                    competition.best(&points[place], around, || graph.log_room(place), counts);
            },
        )?;
        rim.clear();
        for (&place, &best) in free.iter().zip(&best).filter(|(_, best)| **best != NOBODY) {
            labels[place as usize] = best;
            rim.push(place);
        }
        narrow.extend(&rim);
    }
    Ok(labels)
}
