//! The closed loop on sets whose defect it does not know.

use anyhow::{Context, Result};
use trainer::benchmark::{Extent, Judgement, Quantity, Reply, Row, Run, Selection, Suite, Verdict, run, table};

#[test]
fn an_elevation_offset_is_named_with_its_angle_and_nothing_is_named_where_nothing_is() -> Result<()> {
    let mut cases = Selection::short();
    cases.retain(|case| case.suite == Suite::Nothing || case.names == ["elevation_offset"]);
    let mut rows: Vec<Row> = Vec::new();
    run(&cases, Run { extent: Extent::Small, jobs: 2 }, |row| {
        rows.push(row);
        Ok(())
    })?;
    assert_eq!(rows.len(), 2);

    let row = rows.iter().find(|row| row.case.suite == Suite::Single).context("a row")?;
    let judged = Judgement::of(row);
    assert!(judged.right, "{row:?}");
    let (_, offset) = judged.quantities.first().context("an angle")?;
    assert!(offset.is_within(), "{offset:?}");
    assert_eq!(judged.quantities.iter().map(|(_, q): &(_, Quantity)| q.name).collect::<Vec<_>>(), ["offset_deg"]);

    let nothing = rows.iter().find(|row| row.case.suite == Suite::Nothing).context("a row")?;
    let Reply::Answer(answer) = &nothing.reply else { panic!("{nothing:?}") };
    assert_eq!(answer.verdict, Verdict::NothingMissing, "{nothing:?}");

    let text = table(&rows);
    assert!(text.contains("| elevation_offset | 100 % (1 of 1"), "{text}");
    Ok(())
}

#[test]
fn an_error_of_the_taker_ends_the_run() {
    let cases = Selection::short();
    let mut taken = 0;
    let ended = run(&cases[2..3], Run { extent: Extent::Small, jobs: 1 }, |_| {
        taken += 1;
        anyhow::bail!("the disk is full")
    });
    assert_eq!((taken, ended.map_err(|error| error.to_string())), (1, Err("the disk is full".into())));
}
