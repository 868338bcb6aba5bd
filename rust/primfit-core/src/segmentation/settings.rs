//! What the search for planes goes by: every number with its reason, and all of them by name, so
//! that a benchmark can tell which matter (`benches/plane_settings.py`).
//!
//! Two numbers in brackets are the least and the most, unless they are told apart. "Chosen" is a
//! number without a derivation: within a factor of two either way little changes, as the table in
//! `docs/plane_settings.md` shows.

/// A number, or some of one kind, that can be made larger or smaller.
trait Scale: Copy {
    /// Times a factor; whole numbers stay whole, and at least 1.
    fn scaled(self, factor: f64) -> Self;
    /// Its numbers.
    fn numbers(self) -> Vec<f64>;
}

impl Scale for f64 {
    fn scaled(self, factor: f64) -> Self {
        self * factor
    }

    fn numbers(self) -> Vec<f64> {
        vec![self]
    }
}

impl Scale for usize {
    fn scaled(self, factor: f64) -> Self {
        ((self as f64 * factor).round() as usize).max(1)
    }

    fn numbers(self) -> Vec<f64> {
        vec![self as f64]
    }
}

impl<T: Scale> Scale for (T, T) {
    fn scaled(self, factor: f64) -> Self {
        (self.0.scaled(factor), self.1.scaled(factor))
    }

    fn numbers(self) -> Vec<f64> {
        [self.0.numbers(), self.1.numbers()].concat()
    }
}

/// Structs of numbers, each with its value by default, and one struct of them all.
macro_rules! settings {
    (
        $(#[$of_all:meta])*
        $all:ident {
            $(
                $(#[$of_group:meta])*
                $group:ident: $type:ident {
                    $($(#[$of_field:meta])* $field:ident: $number:ty = $value:expr,)+
                }
            )+
        }
    ) => {
        $(#[$of_all])*
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct $all {
            $($(#[$of_group])* pub(crate) $group: $type,)+
        }

        $(
            $(#[$of_group])*
            #[derive(Debug, Clone, Copy, PartialEq)]
            pub(crate) struct $type {
                $($(#[$of_field])* pub(crate) $field: $number,)+
            }

            impl Default for $type {
                fn default() -> Self {
                    Self { $($field: $value,)+ }
                }
            }
        )+

        impl $all {
            /// Every setting by its name, with its numbers.
            pub fn numbers(&self) -> Vec<(&'static str, Vec<f64>)> {
                vec![$($((
                    concat!(stringify!($group), ".", stringify!($field)),
                    self.$group.$field.numbers(),
                ),)+)+]
            }

            /// The same with one of them times a factor; None when there is none of this name.
            #[must_use]
            pub fn scaled(mut self, name: &str, factor: f64) -> Option<Self> {
                match name {
                    $($(concat!(stringify!($group), ".", stringify!($field)) => {
                        self.$group.$field = self.$group.$field.scaled(factor);
                    })+)+
                    _ => return None,
                }
                Some(self)
            }
        }
    };
}

settings! {
/// All numbers of the search for planes in a cloud of which nothing is known; the search in an image
/// goes by those that it shares.
Settings {
    /// The course of the search.
    course: Course {
        /// Points of which each gets a local plane; of more, every second, third ... does. Work.
        most_local: usize = 32_768,
        /// One point in so many at least.
        most_step: usize = 32,
        /// Nearest neighbours that a point touches: half of what shows a plane.
        nearest: (usize, usize) = (10, 64),
        /// Neighbours that are looked at for those that bridge gaps: in clouds that are large, in
        /// others. Work, below `large` hardly any.
        looked_at: (usize, usize) = (32, 96),
        /// Points of a cloud that is large.
        large: usize = 500_000,
        /// Rounds of competition, splitting and merging at most.
        rounds: usize = 4,
        /// They end once no plane gains or loses more than one in so many of its points.
        settled: usize = 100,
        /// Sweeps of competition that begin each.
        sweeps: usize = 2,
        /// Times that patches of curved surfaces are looked for: those around which others were
        /// found have no planes beside them any more.
        passes: usize = 2,
    }
    /// The noise around every point.
    noise: Noise {
        /// Flat neighbourhoods that tell whether all points have one noise.
        fewest: usize = 64,
        /// Flatness of what is a plane but for rounding: a millionth of a radian twice over.
        exact: f64 = 1e8,
        /// Shares of flat neighbourhoods that are such planes where values come in steps: by chance
        /// none are, and more than half are where there is no noise at all.
        stepped: (f64, f64) = (0.005, 0.5),
        /// Such neighbourhoods that are asked for others beside them. Work.
        asked: usize = 1024,
        /// Standard deviations of the logarithm of the noise, exceeded by one neighbourhood in ten,
        /// from which the noise differs: 1.64 if they did not overlap.
        different: f64 = 2.3,
    }
    /// Whether neighbouring points err alike.
    roughness: Roughness {
        /// Flat neighbourhoods that are asked. Work.
        asked: usize = 1024,
        /// How many more points the wider neighbourhood has: four times the extent, where there is
        /// room.
        wider: usize = 16,
        /// One in so many of them must show less growth: wider ones often reach over an edge.
        quartile: usize = 4,
        /// Power of the extent from which surfaces are rough: chance and faint curves stay below.
        rough: f64 = 0.1,
        /// How much wider than the flat one half of the wider neighbourhood must be to tell.
        narrower: f64 = 1.5,
        /// Points of a region that tells of its roughness: its deviation within a tenth.
        telling: f64 = 60.0,
        /// Second smallest over smallest variance of such a region: layers cut from clutter are
        /// thicker.
        thin: f64 = 36.0,
        /// Regions that tell a law: two for its parameters, as many over.
        fewest: usize = 4,
        /// Largest power: beyond it nothing would be flat at any scale.
        roughest: f64 = 0.8,
    }
    /// Planes grown from seeds.
    growth: Growing {
        /// Standard deviations within which a plane takes a point: all but 3 in 1000 of its own.
        take: f64 = 3.0,
        /// Cosine of the angle to a plane beyond which the neighbourhood of a point lies on another
        /// one.
        along: f64 = 0.9,
        /// Standard deviations within which a plane explains a point: 19 in 20 of its own.
        explain: f64 = 2.0,
        /// Standard deviations from its own plane at which a point is no seed.
        seed: f64 = 2.5,
        /// Share of a seed's neighbourhood that must lie on its plane.
        on_plane: f64 = 0.4,
        /// Share of those that must be new.
        new: f64 = 0.3,
        /// Fits of a seed's plane, each to the points near the one before.
        cuts: usize = 4,
        /// Growth of the number of points after which the plane is fitted again. Work.
        refit: f64 = 1.5,
        /// How far the noise of a growing plane may move from its seed's.
        sigma: (f64, f64) = (0.7, 1.3),
    }
    /// Planes that compete for points.
    competition: Competing {
        /// Least share of a point's neighbours that a label counts with: about one of them.
        share: f64 = 0.02,
        /// Standard deviations beyond which a plane does not take a point: one in 16 000 of its own.
        reach: f64 = 4.0,
        /// How much farther from a smooth plane than their noise its points may be: the estimate of
        /// the noise is not perfect, but with more than that a plane would swallow what is beside it.
        slack: f64 = 1.3,
    }
    /// Planes cut in two, and put together.
    merging: Merging {
        /// Squared distance, in variances, that each point of the smaller of two planes may move
        /// when they become one: half a standard deviation.
        move_smooth: f64 = 0.25,
        /// The same where neighbouring points err alike: 1.6 standard deviations.
        move_rough: f64 = 2.56,
        /// What a plane costs, in variances, times the logarithm of its points: one for each of its
        /// three parameters and one for the border (the criterion of Schwarz, 1978).
        plane: f64 = 4.0,
        /// How much larger than the smaller variance of two planes the common one may be.
        unequal: f64 = 4.0,
        /// Places at which a straight cut is tried in each direction. Work.
        bins: usize = 32,
        /// Points of a plane that are looked at for its cuts. Work.
        looked_at: usize = 4096,
    }
    /// Which regions are planes.
    acceptance: Accepting {
        /// Least share of the labelled neighbours among the neighbours with this label or none.
        purity: f64 = 0.5,
        /// Least logarithm of the likelihood ratio of a plane to scattered points: planes of 25
        /// roofs have 28 and more, clutter mostly less.
        evidence: f64 = 14.0,
        /// Second smallest over smallest variance of a plane that tells how thick planes of the cloud
        /// are.
        clear: f64 = 36.0,
        /// Least standard deviation of the logarithm of the thickness of planes of one cloud: noise
        /// depends on range, incidence and surface; planes of the recorded clouds have 0.65 to 1.53
        /// times the usual.
        alike: f64 = 0.2,
        /// Share of their deviation that thin planes count with: where beams graze, noise along
        /// them is less across.
        grazed: f64 = 0.5,
        /// How much thicker than the noise around its points a plane is that must be clearly flat.
        slab: f64 = 1.5,
        /// Standard deviation of a plane on rough surfaces, as a share of its points' noise, below
        /// which it is no plane but one row of the scan, whose beams spread in a plane of their own.
        thinnest: f64 = 1.0 / 3.0,
        /// Points of a plane around which it is compared with scattered ones. Work.
        samples: usize = 16,
        /// How much denser the points must lie on the plane than on its denser side: 8 times in a
        /// Gaussian layer, as dense in a filled volume, even at its faces.
        peak: f64 = 1.5,
        /// The same without the points of other planes: clutter on either side is scattered.
        peak_alone: f64 = 3.0,
        /// Standard deviations from the plane at which its sides begin and end.
        side: (f64, f64) = (1.5, 3.0),
        /// Largest share of a plane's own points among those around it, since more is not known.
        most_share: f64 = 0.99,
        /// Least density of scattered points at the rim of a ball, as a share of that in its middle.
        least_density: f64 = 0.01,
        /// Standard deviations within which scattered points are looked for.
        far: f64 = 10.0,
        /// Standard deviations within which the profile of a plane is.
        close: f64 = 4.0,
        /// Second smallest over smallest variance of a plane, more when it is of few points.
        flat: (f64, f64) = (2.0, 6.0),
        /// The same times the number of its points: chance makes few points flat.
        flat_by_chance: f64 = 288.0,
    }
    /// Curved surfaces.
    curvature: Curving {
        /// Turn of the normal from side to side, radians, from which points are on a curved surface.
        turn: f64 = 0.2,
        /// Fall of the sum of squares, in variances, that tells it: of three curvatures by chance
        /// once in a thousand.
        evidence: f64 = 16.0,
        /// Share of the squares that bending must explain where errors of neighbours are alike:
        /// there it always explains something (0.24 on a true board before a sensor of 16 layers),
        /// and by any number of standard errors.
        explained: f64 = 0.25,
        /// Variance of means over neighbourhoods, in that of as many independent points, below
        /// which noise is white.
        white: f64 = 2.0,
        /// Least share of the points of a plane that bends only with those of others.
        mostly: f64 = 0.75,
        /// How much less its own points turn.
        straighter: f64 = 0.6,
        /// Standard deviations from a curved surface within which its points lie.
        on: f64 = 3.0,
        /// Growth of the number of points after which a surface that goes on beyond the border of a
        /// plane is judged again.
        growth: f64 = 2.0,
        /// Most growth.
        most_growth: f64 = 8.0,
        /// Steps from point to point beyond the border.
        steps: usize = 32,
    }
    /// Planes in pieces, and strips with gaps that chance leaves.
    gaps: Gaps {
        /// How much longer an edge may be than is usual around it: from 2 to 3, panels, slats,
        /// cartons and recorded roofs come out alike; gaps of 6 spacings need less than 3.
        longer: f64 = 2.5,
        /// One in so many of the points around one has no longer edge than is usual: across a gap,
        /// those of more than half of the points on its rim may be.
        usual: usize = 4,
        /// Relative neighbours of a point at most.
        most: usize = 8,
        /// How much more points a gap must leave out than the logarithm of how many places it could
        /// be at: chance leaves out so many once in a thousand planes, `exp(-6.9)`.
        chance: f64 = 6.9,
        /// Nearest points among which the other end of a gap is looked for, as for bridges.
        looked_at: usize = 96,
        /// Length of the shortest gap that no edge crosses, in spacings: the nearest 12 points lie
        /// within it.
        unbridged: f64 = 2.0,
    }
    /// Points in rows.
    rows: Rows {
        /// Points that are asked for their neighbours. Work.
        samples: usize = 128,
        /// The smallest neighbourhood that is looked at, the largest.
        sizes: (usize, usize) = (4, 8192),
        /// A neighbourhood that reaches the next row is at most one in so many of all points: the
        /// rows of a surface are many, the walls of a low room are four.
        parts: usize = 32,
        /// Neighbourhood that shows a surface when it is this large and reaches the next row.
        enough: usize = 32,
        /// The same where rows are beams that were measured again and again.
        few: usize = 4,
        /// Dimension of a surface, at least.
        surface: f64 = 1.9,
        /// By what factor it rises, at least, while neighbourhoods that reach the next rows double.
        rise: f64 = 1.3,
        /// Neighbourhoods so many times smaller lie within a row, so many times larger reach over
        /// some.
        within: usize = 4,
        /// Width of a row, at most, in the thickness of what it lies on.
        thin: f64 = 2.0,
        /// The same in the reach over some rows.
        narrow: f64 = 0.03,
        /// Share of the variance of a row's part that is across the surface, if the row is a beam.
        across: f64 = 0.5,
    }
}
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn one_setting_is_scaled_by_its_name() {
        let usual = Settings::default();
        let other = usual.scaled("growth.take", 2.0).unwrap();
        assert_eq!(other.growth.take, 2.0 * usual.growth.take);
        assert_eq!(Settings { growth: usual.growth, ..other }, usual);
        assert_eq!(usual.scaled("gaps.usual", 0.01).unwrap().gaps.usual, 1);
        assert_eq!(usual.scaled("growth.none", 2.0), None);
        for (name, numbers) in usual.numbers() {
            let twice = usual.scaled(name, 2.0).unwrap().numbers();
            let changed = twice.iter().find(|setting| setting.0 == name).unwrap();
            let doubled: Vec<f64> = numbers.iter().map(|number| 2.0 * number).collect();
            assert_eq!(changed.1, doubled, "{name}");
        }
    }
}
