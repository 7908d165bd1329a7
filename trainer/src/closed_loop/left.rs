//! What still depends on something when no effect and no table passes any more.

use super::outcome::{Caveat, Unexplained};
use super::screen::Screening;

/// Share of a channel's residual that depends on something, from which on it is said.
const LEAST_SHARE: f64 = 0.05;

/// Probability of such a share by chance, adjusted, up to which it is said.
const CHANCE: f64 = 0.05;

/// The largest dependence of each channel.
pub fn left(screening: &Screening) -> Vec<Unexplained> {
    let mut left: Vec<Unexplained> = Vec::new();
    for d in &screening.dependences {
        let is_known = left.iter().any(|u| u.channel == d.channel);
        if d.share > LEAST_SHARE && d.q_value < CHANCE && !d.covariates.is_empty() && !is_known {
            left.push(Unexplained {
                channel: d.channel,
                covariates: d.covariates.iter().map(|c| c.name().to_owned()).collect(),
                share_of_residual: d.share,
                q_value: d.q_value,
                added_as_table: false,
            });
        }
    }
    left
}

/// The same where an image knows too little to say that something is missing.
pub fn limit(left: &Unexplained) -> Caveat {
    format!(
        "what is left of {} depends on {} ({:.0} % of the residual): no more than what a scan does not know of surfaces beside what was found",
        format!("{:?}", left.channel).to_lowercase(),
        left.covariates.join(" and ").replace('_', " "),
        100.0 * left.share_of_residual
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed_loop::screen::Dependence;
    use crate::effects::{Channel, Covariate};

    #[test]
    fn the_largest_dependence_of_each_channel_is_said_if_it_is_large_and_no_chance() {
        let dependence = |channel, covariate, share, q_value| Dependence {
            channel,
            covariates: vec![covariate],
            share,
            ci95: [0.0, 1.0],
            p_value: q_value,
            q_value,
            curve: vec![],
        };
        let screening = Screening {
            dependences: vec![
                dependence(Channel::Range, Covariate::Ring, 0.3, 0.2),
                dependence(Channel::Range, Covariate::Class, 0.2, 0.001),
                dependence(Channel::Range, Covariate::Range, 0.1, 0.001),
                dependence(Channel::Missing, Covariate::Height, 0.04, 0.001),
            ],
            maps: vec![],
        };
        let left = left(&screening);
        assert_eq!(left.len(), 1);
        assert_eq!((left[0].channel, left[0].covariates.as_slice()), (Channel::Range, &["class".to_owned()][..]));
    }
}
