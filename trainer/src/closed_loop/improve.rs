//! The loop itself: try every effect that the model lacks, add the best that holds its own, refit all, drop what no longer earns its
//! place, and stop when nothing passes.

use std::cell::OnceCell;
use std::ops::Range;

use super::black_box::{Table, Tables};
use super::candidate::{Trial, try_all};
use super::data::Batch;
use super::doubt;
use super::evidence::evidence;
use super::fit::Manner;
use super::glance::{COULD_PASS, gain_of_geometry};
use super::halves::Halves;
use super::judged::{Judged, choose};
use super::left::{left, limit};
use super::model::{SensorModel, Term};
use super::outcome::{Candidate, Found, Interval, Outcome, Round, Unexplained};
use super::placebo::{self, permuted};
use super::refit::{physical_stderr, refitted};
use super::score::{Scope, total};
use super::screen::{Screening, screen};
use super::significance::benjamini_hochberg;
use crate::effects::{ActsOn, Channel, Kind, library};

/// False discoveries among the claims.
const FALSE_DISCOVERIES: f64 = 0.05;

/// Least held-out gain of a claim, nats a ray.
const LEAST_GAIN: f64 = 3e-5;

/// Least held-out gain of a claim, nats in all: what chance gives a single number hardly ever.
const LEAST_NATS: f64 = 8.0;

/// Most effects that are added.
const MOST_ROUNDS: usize = 6;

/// Most tables that are added.
const MOST_TABLES: usize = 3;

/// Share of a table's gain that an effect has to reach to hold its own; against a table over nothing but its own covariates, which says no
/// more than that its form is not exact, the second.
const HOLDS_ITS_OWN: [f64; 2] = [0.8, 0.5];

/// The same of several effects together.
const HOLD_THEIR_OWN: [f64; 2] = [1.0, 0.95];

/// Share of a named effect's gain below which a table over the same covariates is about the effect's form.
const FORM: f64 = 0.05;

/// Share of the best gain from which on an effect that moves rays may be one of several that do.
const LIKELY: f64 = 0.25;

/// How many times the gain of the best effect what moves rays must gain together to come first.
const FAR_MORE: f64 = 1.2;

/// Share of an effect's gain that its placebo, or a table in its place, has to reach where it is fitted to be worth more than a glance.
const FAR_LESS: f64 = 0.5;

/// Effects of a number a ring, and those that are the same with one number.
const SIMPLER: [[&str; 2]; 4] = [
    ["elevation_offset_per_ring", "elevation_offset"],
    ["azimuth_offset_per_ring", "mount_yaw"],
    ["range_offset_per_ring", "range_offset"],
    ["ring_gain", "reflectance_gain"],
];

/// Standard errors by which a number has to differ from nothing for an effect to be claimed in the end.
const SURE: f64 = 3.0;

/// Seed of the screening's bootstrap.
const SEED: u64 = 1;

/// What a round tells whoever waits.
pub type Progress<'p> = &'p dyn Fn(&str);

/// Closes the loop on the scenes of both halves. Nothing else is looked at.
pub fn improve(before: &SensorModel, batches: [Vec<&Batch>; 2], progress: Progress<'_>) -> Outcome {
    let all = batches.concat();
    let before = before.clone().with_noise_of(&evidence(before, &all));
    let before = refitted(&before, &all, Manner::EXACT);
    let screening_before = screen(&before, &all, SEED);
    let mut search = Search {
        model: before.clone(),
        batches,
        all: all.clone(),
        found: vec![],
        tables: vec![],
        rounds: vec![],
        progress,
    };
    let mut last = None;
    for _ in 0..MOST_TABLES {
        last = search.add_named();
        if !search.replace_mimics() {
            break;
        }
        last = None;
    }
    search.add_tables(last);
    let errors = search.settle();
    let screening_after = screen(&search.model, &all, SEED);
    search.finish(before, &errors, screening_before, screening_after)
}

/// A search on its way.
struct Search<'a> {
    model: SensorModel,
    batches: [Vec<&'a Batch>; 2],
    all: Vec<&'a Batch>,
    found: Vec<Found>,
    tables: Vec<Table>,
    rounds: Vec<Round>,
    progress: Progress<'a>,
}

impl<'a> Search<'a> {
    /// Adds the best effect of the library that passes, refits, drops what has become idle; until nothing passes. What the model makes
    /// of both halves then.
    fn add_named(&mut self) -> Option<Halves<'a>> {
        for _ in 0..MOST_ROUNDS {
            let halves = Halves::new(&self.model, self.batches.clone());
            let trials = try_all(&self.model, &halves, |term| self.least_gain(term), self.progress);
            let q = benjamini_hochberg(&trials.iter().map(|t| t.p_value).collect::<Vec<_>>());
            let mut judged: Vec<Judged> = trials
                .into_iter()
                .zip(q)
                .map(|(trial, q_value)| Judged::new(self.passes(&trial, q_value, halves.rays), trial, q_value))
                .collect();
            judged.sort_by(|a, b| b.trial.gain.value.total_cmp(&a.trial.gain.value));
            let geometry_first = self.is_geometry_first(&judged, &halves);
            let choice = self.best(&mut judged, geometry_first);
            let decision = choice.as_ref().map_or("nothing passes: stop".into(), |(w, _)| format!("add {}", w.name()));
            (self.progress)(&decision);
            self.rounds.push(Round { candidates: judged.iter().map(Judged::candidate).collect(), decision });
            let Some((winner, ties)) = choice else { return Some(halves) };
            let newest = winner.name();
            let Judged { trial, q_value, .. } = winner;
            self.model = self.model.with(&trial.like).with(std::slice::from_ref(&trial.term));
            self.found.push(Found { term: trial.term, stderr: vec![], gain: trial.gain, q_value, ties });
            self.model = refitted(&self.model, &self.all, Manner::TRIAL);
            self.drop_idle(newest);
        }
        None
    }

    /// Whether what moves rays explains more, taken together, than the best single effect, which is none of them: where several effects
    /// move rays each explains little alone, and what lets ranges scatter makes up for all of them.
    fn is_geometry_first(&self, judged: &[Judged], halves: &Halves<'_>) -> bool {
        let Some(best) = judged.iter().find(|j| j.passed) else { return false };
        let is_likely = |j: &Judged| j.trial.term.is_geometric() && j.trial.gain.value > LIKELY * best.trial.gain.value;
        !best.trial.term.is_geometric()
            && judged.iter().any(|j| j.passed && is_likely(j))
            && gain_of_geometry(&self.model, halves, &evidence(&self.model, &halves.sample))
                > FAR_MORE * best.trial.gain.value
    }

    /// The best candidate that gains more than its placebo, with its ties; those that do not have not passed.
    fn best(&self, judged: &mut [Judged], geometry_first: bool) -> Option<(Judged, Vec<String>)> {
        let (scans, there) = (OnceCell::new(), OnceCell::new());
        loop {
            let (at, ties) = choose(judged, |j| !geometry_first || j.trial.term.is_geometric())?;
            let trial = &judged[at].trial;
            if !placebo::is_telling(trial) {
                return Some((judged[at].clone(), ties));
            }
            let scans = scans.get_or_init(|| self.batches.each_ref().map(|half| permuted(&self.model, half, SEED)));
            let (halves, evidence) = there.get_or_init(|| {
                let halves = Halves::new(&self.model, scans.each_ref().map(|half| half.iter().collect()));
                let evidence = evidence(&self.model, &halves.batches[0]);
                (halves, evidence)
            });
            let least = FAR_LESS * trial.gain.value;
            let placebo = Trial::of(&self.model, &trial.term.effect, halves, evidence, least);
            let beaten = !placebo.is_as_good_as(trial);
            judged[at].placebo = Some(placebo.gain);
            if beaten {
                return Some((judged[at].clone(), ties));
            }
            judged[at].passed = false;
        }
    }

    /// Whether a candidate may be claimed.
    fn passes(&self, trial: &Trial, q: f64, rays: f64) -> bool {
        !trial.only_glanced
            && q < FALSE_DISCOVERIES
            && trial.gain.value > self.least_gain(&trial.term)
            && trial.gain.value * rays > LEAST_NATS + 0.5 * trial.size() as f64
            && trial.gain.ci95[0] > 0.0
            && trial.is_plausible()
    }

    /// Least held-out gain with which a term is claimed, nats a ray.
    fn least_gain(&self, term: &Term) -> f64 {
        LEAST_GAIN.max(self.doubt(term.effect.about().acts_on, term.name()))
    }

    /// What something that acts on these likelihoods could gain because the image knows less than the effects that were found need; an
    /// effect does not doubt itself.
    fn doubt(&self, acts_on: ActsOn, name: &str) -> f64 {
        let others = self.found.iter().filter(|found| found.term.name() != name);
        let beside_effects: f64 = others.map(|found| doubt::beside(found, acts_on)).sum();
        beside_effects + self.tables.iter().map(|table| doubt::beside_table(table, acts_on)).sum::<f64>()
    }

    /// Drops effects whose absence the others make up for; the newest has just been found to be needed.
    fn drop_idle(&mut self, newest: &str) {
        let older = self.model.effects().iter().filter(|t| t.name() != newest && self.is_found(t.name()));
        for term in older.cloned().collect::<Vec<Term>>() {
            let (name, scope) = (term.name(), Scope::of(&term));
            let without = refitted(&self.model.without(name), &self.all, Manner::TRIAL);
            let gain = total(&self.model, &self.all, scope) - total(&without, &self.all, scope);
            if gain < LEAST_NATS + term.fitted.len() as f64 {
                (self.progress)(&format!("drop {name}: the others make up for it"));
                self.found.retain(|f| f.term.name() != name);
                self.model = without;
            }
        }
    }

    fn is_found(&self, name: &str) -> bool {
        self.found.iter().any(|found| found.term.name() == name)
    }

    /// Effects that a table in their place beats are mimics of something that has no name: the table takes their place. All effects of
    /// a channel together first, for several mimics may each make up for what the others lack; then each by itself. Whether any was.
    fn replace_mimics(&mut self) -> bool {
        let mut replaced = false;
        for acts_on in [ActsOn::RANGE, ActsOn::REFLECTANCE, ActsOn::RETURNS] {
            let of_channel = |f: &&Found| f.term.effect.about().acts_on == acts_on;
            let names: Vec<&'static str> = self.found.iter().filter(of_channel).map(|f| f.term.name()).collect();
            if names.len() > 1 {
                replaced |= self.replace_if_mimics(&names);
            }
        }
        let newest_first: Vec<&'static str> = self.found.iter().rev().map(|f| f.term.name()).collect();
        for name in newest_first {
            if self.is_found(name) {
                replaced |= self.replace_if_mimics(&[name]);
            }
        }
        replaced
    }

    /// Replaces these effects by a table that beats them, if there is one.
    fn replace_if_mimics(&mut self, names: &[&'static str]) -> bool {
        let are_named = |f: &&Found| names.contains(&f.term.name());
        (self.progress)(&format!("would a table do better than {}?", names.join(" and ")));
        let terms: Vec<&Term> = self.model.effects().iter().filter(|t| names.contains(&t.name())).collect();
        let q_value = self.found.iter().filter(are_named).map(|f| f.q_value).fold(0.0, f64::max);
        let without = names.iter().fold(self.model.clone(), |model, name| model.without(name));
        let without = refitted(&without, &self.all, Manner::TRIAL);
        let halves = Halves::new(&without, self.batches.clone());
        let named = Trial::of_found(&terms, &self.model, &halves);
        let screening = screen(&without, &self.all, SEED);
        // Several effects have little excuse: a single table that is better than all of them knows what they do not.
        let own: Vec<&str> = terms.iter().flat_map(|t| t.effect.about().covariates.iter().copied()).collect();
        let enough = |table: &Table| {
            let share = if names.len() > 1 { HOLD_THEIR_OWN } else { HOLDS_ITS_OWN };
            share[usize::from(table.covariates.iter().all(|c| own.contains(&c.name())))]
        };
        let acts_on = terms.iter().map(|t| t.effect.about().acts_on).fold(ActsOn::default(), ActsOn::or);
        let least = |_: &Term| FAR_LESS * named.gain.value;
        let tables = Tables::new(&without, &halves, &screening, &least);
        let better = channels(acts_on)
            .filter_map(|channel| tables.best(channel))
            .filter(|t| self.passes(&t.trial, t.q_value, halves.rays))
            .filter(|t| named.gain.value < enough(t) * t.trial.gain.value && !named.is_as_good_as(&t.trial))
            .max_by(|a, b| a.trial.gain.value.total_cmp(&b.trial.gain.value));
        let Some(table) = better else { return false };
        let they = if names.len() > 1 { "they do not hold their" } else { "it does not hold its" };
        let decision = format!("replace {} by {}: {they} own", names.join(" and "), table.trial.name());
        (self.progress)(&decision);
        let judged = |trial: Trial, q_value: f64, passed: bool| Judged::new(passed, trial, q_value).candidate();
        let mut candidates = vec![judged(table.trial.clone(), table.q_value, true)];
        candidates.push(Candidate { name: names.join(" and "), ..judged(named, q_value, false) });
        self.rounds.push(Round { candidates, decision });
        self.found.retain(|f| !names.contains(&f.term.name()));
        self.model = without;
        // What the table stands for may be what others mimicked.
        let newest = table.trial.name();
        self.add(table);
        self.drop_idle(newest);
        true
    }

    /// Adds tables for what is left, until nothing passes; `known` is what the model makes of both halves, where that is known.
    fn add_tables(&mut self, known: Option<Halves<'a>>) {
        let mut known = known;
        for _ in 0..MOST_TABLES {
            (self.progress)("what is left");
            let halves = known.take().unwrap_or_else(|| Halves::new(&self.model, self.batches.clone()));
            let screening = screen(&self.model, &self.all, SEED);
            let least = |table: &Term| COULD_PASS * self.least_gain(table);
            let tables = Tables::new(&self.model, &halves, &screening, &least);
            let best = channels(ActsOn::ALL)
                .filter_map(|channel| tables.best(channel))
                .filter(|t| self.passes(&t.trial, t.q_value, halves.rays) && !self.is_form_of_found(t))
                .max_by(|a, b| a.trial.gain.value.total_cmp(&b.trial.gain.value));
            let Some(table) = best else { return };
            let decision = format!("add {}: no effect of the library explains it", table.trial.name());
            (self.progress)(&decision);
            let judged = Judged::new(true, table.trial.clone(), table.q_value);
            self.rounds.push(Round { candidates: vec![judged.candidate()], decision });
            self.add(table);
        }
    }

    /// Whether a table is no more than a named effect's own law written a little differently: the same covariates, next to no gain.
    fn is_form_of_found(&self, table: &Table) -> bool {
        self.found.iter().any(|found| {
            let covariates = found.term.effect.about().covariates;
            table.covariates.iter().all(|c| covariates.contains(&c.name()))
                && table.trial.gain.value < FORM * found.gain.value
        })
    }

    fn add(&mut self, table: Table) {
        self.model.terms.push(table.trial.term.clone());
        self.model = refitted(&self.model, &self.all, Manner::TRIAL);
        self.tables.push(table);
    }

    /// Puts one number in the place of one a ring where, beside the effects that were found since, it explains as much.
    fn simplify(&mut self) {
        for [name, simpler] in SIMPLER {
            let Some(at) = self.found.iter().position(|found| found.term.name() == name) else { continue };
            if self.model.has(simpler) {
                continue;
            }
            let term = self.model.effects().iter().find(|term| term.name() == name).cloned();
            let term = term.unwrap_or_else(|| unreachable!("what was found is in the model"));
            let effect = library().into_iter().find(|effect| effect.about().name == simpler);
            let effect = effect.unwrap_or_else(|| unreachable!("{simpler} is in the library"));
            let physical = term.physical();
            let mean = |range: Range<usize>| physical[range.clone()].iter().sum::<f64>() / range.len() as f64;
            let means: Vec<f64> = term.layout().into_iter().map(|(_, range)| mean(range)).collect();
            let start = Term::new(effect, physical.len() / means.len()).at(&means);

            let without = self.model.without(name);
            let instead = refitted(&without.with(std::slice::from_ref(&start)), &self.all, Manner::TRIAL);
            let halves = Halves::new(&refitted(&without, &self.all, Manner::TRIAL), self.batches.clone());
            let fitted = instead.effects().iter().find(|term| term.name() == simpler).cloned();
            let fitted = fitted.unwrap_or_else(|| unreachable!("it was added"));
            let trial = Trial::of_found(&[&fitted], &instead, &halves);
            let named = Trial::of_found(&[&term], &self.model, &halves);
            // A ring's own number beside one for all is as doubtful as anything else beside it.
            let lost = named.gain.value - trial.gain.value;
            if !trial.is_as_good_as(&named) && lost > self.doubt(fitted.effect.about().acts_on, "") {
                continue;
            }
            (self.progress)(&format!("{simpler} in place of {name}: beside the others it explains as much"));
            self.model = instead;
            self.found[at] = Found { term: fitted, gain: trial.gain, ..self.found[at].clone() };
            self.drop_idle(simpler);
        }
    }

    /// Fits everything together once more, and drops what may then be nothing: an effect that made up for others before they were found.
    /// The standard errors of what remains.
    fn settle(&mut self) -> Vec<Vec<f64>> {
        self.simplify();
        loop {
            (self.progress)("everything together");
            self.model = refitted(&self.model, &self.all, Manner::EXACT);
            (self.progress)("standard errors");
            let errors = physical_stderr(&self.model, &self.all);
            let terms = self.model.terms.iter().zip(&errors);
            let unsure = terms.filter(|(term, errors)| self.is_found(term.name()) && may_be_nothing(term, errors));
            let Some(name) = unsure.map(|(term, _)| term.name()).next() else { return errors };
            (self.progress)(&format!("drop {name}: beside the others it may be nothing"));
            self.found.retain(|found| found.term.name() != name);
            self.model = self.model.without(name);
        }
    }

    /// The outcome; `stderr` are the standard errors of the model.
    fn finish(
        self,
        before: SensorModel,
        stderr: &[Vec<f64>],
        screening_before: Screening,
        screening_after: Screening,
    ) -> Outcome {
        let after = self.model.clone();
        let with_errors = |found: Found| {
            let i = after.terms.iter().position(|t| t.name() == found.term.name());
            let i = i.unwrap_or_else(|| unreachable!("what was found is in the model"));
            let (term, stderr) = (after.terms[i].clone(), stderr[i].clone());
            let lasting = term.effect.ties(&term.physical(), &stderr).iter().map(|tie| (*tie).to_owned());
            let mut ties: Vec<String> = found.ties.into_iter().chain(lasting).collect();
            // What was added after all is no tie.
            ties.retain(|tie| !after.has(tie));
            ties.dedup();
            Found { term, stderr, gain: found.gain, q_value: found.q_value, ties }
        };
        let declared: Vec<Found> = before
            .effects()
            .iter()
            .map(|term| Found {
                term: term.clone(),
                stderr: vec![],
                gain: Interval::default(),
                q_value: 0.0,
                ties: vec![],
            })
            .collect();
        let mut unexplained: Vec<Unexplained> = self.tables.iter().map(Table::unexplained).collect();
        let (of_images, of_sensor): (Vec<Unexplained>, Vec<Unexplained>) =
            left(&screening_after).into_iter().partition(|u| self.doubt(doubt::likelihoods(u.channel), "") > 0.0);
        unexplained.extend(of_sensor);
        Outcome {
            rounds: self.rounds,
            effects: self.found.into_iter().map(with_errors).collect(),
            declared: declared.into_iter().map(with_errors).collect(),
            unexplained,
            screening_before,
            screening_after,
            caveats: of_images.iter().map(limit).collect(),
            before,
            after,
        }
    }
}

/// Whether every number of a term is hardly more than its standard error from where it leaves scans as they are.
fn may_be_nothing(term: &Term, stderr: &[f64]) -> bool {
    let physical = term.physical();
    term.layout().into_iter().all(|(parameter, range)| {
        let is_near = |i: usize| (physical[i] - parameter.start).abs() < SURE * stderr[i];
        parameter.kind == Kind::Free && range.into_iter().all(is_near)
    })
}

/// The channels of which a table could take the place of an effect.
fn channels(acts_on: ActsOn) -> impl Iterator<Item = Channel> {
    let of = |on: bool, channel: Channel| on.then_some(channel);
    [
        of(acts_on.range, Channel::Range),
        of(acts_on.range, Channel::RangeVariance),
        of(acts_on.reflectance, Channel::Reflectance),
        of(acts_on.returns, Channel::Missing),
    ]
    .into_iter()
    .flatten()
}
