//! The tables and figures of a report, each with a caption that says what it shows, of which scene, on what, from how many samples.

use crate::base::numbers::{capitalised, figure, plain};
use crate::measure::densities::comparison::FIGURE as MODELS_FIGURE;
use crate::report::document::{Document, Figure};
use crate::report::inputs::{ATTRIBUTION_FIGURE, Inputs, Run, TUNING_FIGURE, study_figure};
use crate::report::measured::{ablations, attributions, curves, fronts, percent, study_captions};
use crate::report::summary::{Summary, evaluator_name};
use crate::report::table::{Cell, Table};
use crate::report::tables::{TuningTable, model_rows};

/// Scene and adapter of a run, as a caption ends.
fn place(run: &Run) -> String {
    let scene = run.scene.as_ref().map(|name| format!("Scene {name}"));
    let adapter = run.adapter.get("name").map(|name| format!("adapter {}", plain(name)));
    let known: Vec<String> = [scene, adapter].into_iter().flatten().collect();
    if known.is_empty() { String::new() } else { format!(" {}.", known.join("; ")) }
}

/// The page without its pictures' viewer: for terminals, repositories and papers.
pub fn document(inputs: &Inputs, summary: &Summary) -> Document {
    let mut document = Document::new(&summary.title, &format!("{}.", capitalised(summary.words)), &summary.sentence);
    let place = place(&inputs.run);
    let parts = summary
        .parts
        .iter()
        .map(|part| vec![Cell::text(part.name.clone()), Cell::text(part.words), Cell::text(part.sentence.clone())]);
    document.table(Table::new(format!("Verdicts.{place}"), &[("Part", ""), ("Verdict", ""), ("Found", "")], parts));
    picture(&mut document, inputs, &place);
    fields(&mut document, inputs);
    if let Some(bench) = &inputs.bench {
        document.heading("Speed against Cycles");
        let software = bench.software_adapter();
        let rows = bench.rows.iter().map(|row| {
            let mega = |rate: Option<f64>| Cell::Number(rate.map(|rate| rate / 1e6));
            let gpu = Cell::Number(row.gpu_ratio.filter(|_| !software));
            vec![
                Cell::text(row.what.clone()),
                Cell::Count(row.points),
                mega(row.cycles_rate),
                mega(row.cpu_rate),
                Cell::Number(row.cpu_ratio),
                gpu,
            ]
        });
        let heads = [
            ("Work", ""),
            ("Points", ""),
            ("Cycles", "10⁶/s"),
            ("CPU", "10⁶/s"),
            ("CPU over Cycles", ""),
            ("GPU over Cycles", ""),
        ];
        document.table(Table::new(
            format!(
                "Rates of evaluation, ours and those of Cycles, in one run on one machine. Adapter: {}.",
                plain(&bench.adapter)
            ),
            &heads,
            rows,
        ));
    }
    if let Some(study) = &inputs.study {
        document.heading(&format!("Error against time: {}", study.study.title));
        let is_wide = study.groups().len() > 1;
        let stems = crate::measure::study::FIGURES.map(|(_, stem)| stem);
        for ((stem, caption), is_wide) in stems.into_iter().zip(study_captions(study)).zip([is_wide, is_wide, true]) {
            let file = study_figure(stem);
            if inputs.pictures.contains_key(&file) {
                document.figure(Figure { print: with_extension(&file, "pdf"), file, is_wide, caption });
            }
        }
        fronts(study).into_iter().chain(ablations(study)).for_each(|table| document.table(table));
        document.table(curves(study));
    }
    if let Some(tuning) = &inputs.tuning {
        document.heading(&format!("Tuning: {}", tuning.file.title));
        if inputs.pictures.contains_key(TUNING_FIGURE) {
            let caption = format!(
                "Held-out views of {}: path tracing, the best published light model at its matched exposure, and tuned, with their HDR-FLIP \
                 maps; below, the search.",
                tuning.file.title
            );
            let (file, print) = (TUNING_FIGURE.to_owned(), with_extension(TUNING_FIGURE, "pdf"));
            document.figure(Figure { file, print, is_wide: true, caption });
        }
        let shown = TuningTable::of(tuning, &inputs.pictures);
        document.table(shown.models);
        document.table(shown.parameters);
    }
    if let Some(found) = &inputs.attribution {
        let title = &found.attribution.title;
        document.heading(&format!("Where the error is born: {title}"));
        if inputs.pictures.contains_key(ATTRIBUTION_FIGURE) {
            let caption = format!(
                "{title}: from the engine's relMSE to what is left where every stage is exact, and each stage's share of every pixel's signed \
                 difference."
            );
            let (file, print) = (ATTRIBUTION_FIGURE.to_owned(), with_extension(ATTRIBUTION_FIGURE, "pdf"));
            document.figure(Figure { file, print, is_wide: true, caption });
        }
        attributions(found).into_iter().for_each(|table| document.table(table));
    }
    models(&mut document, inputs);
    if let Some(found) = &inputs.stability {
        document.heading("Numerical stability");
        let rows = found.rows.iter().map(|row| {
            vec![
                Cell::text(row.id.clone()),
                Cell::text(row.varied.clone()),
                Cell::Count(Some(row.values as u64)),
                Cell::Count(Some(row.nonfinite as u64)),
                Cell::text(figure(Some(row.max_error))),
                Cell::text(figure(Some(row.limit))),
                Cell::text(figure(row.share_of_bound)),
                Cell::text(row.verdict.word().to_lowercase()),
            ]
        });
        let heads = [
            ("Row", ""),
            ("Varied", ""),
            ("Values", ""),
            ("NaN/Inf", ""),
            ("Error", ""),
            ("Limit", ""),
            ("Of bound", ""),
            ("Verdict", ""),
        ];
        let caption = format!(
            "Largest errors of f32 against f64 at extremes: scene {}, pictures of {}; WGSL on {}.",
            found.scene,
            found.pictures_of,
            found.adapter.as_deref().unwrap_or("no adapter"),
        );
        document.table(Table::new(caption, &heads, rows));
    }
    if !inputs.left_out.is_empty() {
        document.heading("Left out");
        let rows = inputs.left_out.iter().map(|item| {
            vec![Cell::text(item.what.clone()), Cell::text(item.why.clone()), Cell::text(item.remedy.clone())]
        });
        document.table(Table::new(
            "What is left out of this report.",
            &[("What", ""), ("Why", ""), ("Remedy", "")],
            rows,
        ));
    }
    document
}

fn picture(document: &mut Document, inputs: &Inputs, place: &str) {
    let Some(diff) = &inputs.diff else { return };
    document.heading("Picture");
    let size = diff.images.as_ref().map_or(String::new(), |images| {
        let replicas = |side: &crate::measure::pictures::SideFiles| match side.replicas {
            1 => "1 replica".to_owned(),
            number => format!("{number} replicas"),
        };
        format!(
            ", {} × {} pixels, {} of ours and {} of the reference",
            images.width,
            images.height,
            replicas(&images.ours),
            replicas(&images.reference)
        )
    });
    let whole = format!("{size}.{place}");
    for (name, what) in [
        ("ours.png", "Our picture"),
        ("reference.png", "The reference's picture"),
        ("difference.png", "Relative difference of luminance, blue where ours is darker"),
    ] {
        if inputs.pictures.contains_key(name) {
            let [file, print] = [name, name].map(str::to_owned);
            document.figure(Figure { file, print, is_wide: false, caption: format!("{what}{whole}") });
        }
    }
    let channels = diff.channels.iter().flatten().map(|row| {
        let difference = row.relative_difference.map(percent);
        let known = row.standard_error_relative.map(percent);
        let mean =
            |value, error: Option<f64>| error.map_or(Cell::Number(Some(value)), |error| Cell::Uncertain(value, error));
        vec![
            Cell::text(row.channel.clone()),
            mean(row.ours, row.ours_standard_error),
            mean(row.reference, row.reference_standard_error),
            difference.map_or(Cell::Number(None), |value| mean(value, known)),
        ]
    });
    let heads = [("Channel", ""), ("Ours", ""), ("Reference", ""), ("Difference", "%")];
    document.table(Table::new(format!("Means of the picture's channels, scene-linear{whole}"), &heads, channels));
    let sides = [("Colour", &diff.colour), ("Alpha", &diff.alpha)];
    let figures = sides.iter().filter_map(|(name, found)| {
        let found = found.as_ref()?;
        Some(vec![
            Cell::text(*name),
            Cell::Number(Some(found.mean_error)),
            Cell::Number(Some(found.rms_error)),
            Cell::Number(found.psnr),
            Cell::Number(Some(found.max_error)),
            Cell::Number(Some(percent(found.failing_share))),
        ])
    });
    let heads = [("", ""), ("Mean error", ""), ("RMS", ""), ("PSNR", "dB"), ("Maximum", ""), ("Failing pixels", "%")];
    document.table(Table::new(format!("Errors of the picture by OpenImageIO, scene-linear{whole}"), &heads, figures));
    if let Some(relmse) = &diff.relmse {
        document.text(&format!(
            "relMSE = {}, epsilon {}: pixels {}, block means {}.",
            relmse.formula,
            figure(Some(relmse.epsilon)),
            figure(relmse.pixel),
            figure(relmse.block)
        ));
    }
    let Some(found) = &diff.statistics else { return };
    document.heading("Bias and noise");
    let rows = found.means.iter().map(|row| {
        let bias = match (row.relative_bias, row.relative_standard_error) {
            (Some(bias), Some(error)) => Cell::Uncertain(percent(bias), percent(error)),
            (bias, _) => Cell::Number(bias.map(percent)),
        };
        vec![
            Cell::text(row.channel.clone()),
            bias,
            Cell::Number(row.relative_low.map(percent)),
            Cell::Number(row.relative_high.map(percent)),
            Cell::Number(Some(row.t)),
            Cell::Number(Some(row.p)),
            Cell::Number(Some(row.noise_variance_ours)),
            Cell::Number(Some(row.noise_variance_reference)),
        ]
    });
    let heads = [
        ("Channel", ""),
        ("Bias", "%"),
        ("from", "%"),
        ("to", "%"),
        ("t", ""),
        ("p", ""),
        ("Noise variance, ours", ""),
        ("reference", ""),
    ];
    let caption =
        format!("Bias of the picture's means with its {} % interval, apart from noise{whole}", percent(found.interval));
    document.table(Table::new(caption, &heads, rows));
}

fn fields(document: &mut Document, inputs: &Inputs) {
    for probe in &inputs.probes {
        let domain = probe.domain.as_ref().map_or(String::new(), |domain| format!(" of the domain {}", plain(domain)));
        document.heading(&format!("Field at {} points{domain}", probe.points));
        let rows = probe.evaluators.iter().map(|(name, found)| {
            vec![
                Cell::text(evaluator_name(name)),
                Cell::Count(found.differing),
                Cell::text(figure(found.max_error)),
                Cell::text(figure(found.p999_error)),
                Cell::text(figure(found.rms_error)),
                Cell::Number(found.seconds.map(|seconds| 1e3 * seconds)),
            ]
        });
        let scene =
            probe.scene.as_ref().or(inputs.run.scene.as_ref()).map_or(String::new(), |name| format!(", scene {name}"));
        let target = probe.target.as_ref().map_or("the field".into(), plain);
        let seed = probe.seed.as_ref().map_or(String::new(), |seed| format!(", seed {}", plain(seed)));
        let adapter = inputs.run.adapter.get("name").map_or(String::new(), |name| format!("; GPU: {}", plain(name)));
        let reference = ["renderer", "blender"]
            .iter()
            .filter_map(|name| probe.reference.get(*name))
            .map(plain)
            .collect::<Vec<_>>()
            .join(" ");
        let caption = format!(
            "Errors of {target} against {} at {} points{domain}{seed}{scene}{adapter}.",
            if reference.is_empty() { "the reference" } else { &reference },
            probe.points,
        );
        let heads =
            [("Evaluator", ""), ("Differing", ""), ("Maximum", ""), ("99.9 %", ""), ("RMS", ""), ("Time", "ms")];
        document.table(Table::new(caption, &heads, rows));
    }
}

fn models(document: &mut Document, inputs: &Inputs) {
    let Some(found) = &inputs.models else { return };
    document.heading("Density models side by side");
    let titles: Vec<String> = found.sides.iter().map(|side| side.title.clone()).collect();
    let adapter = found.adapter.as_ref().map_or(String::new(), |adapter| format!("; adapter: {}", plain(adapter)));
    if inputs.pictures.contains_key(MODELS_FIGURE) {
        let caption = format!(
            "{} at the same mean optical depth, {}³ places: how often a density occurs where there is any (left), power of the density \
             over its mean (right).",
            titles.join(", "),
            found.settings.places
        );
        let (file, print) = (MODELS_FIGURE.to_owned(), with_extension(MODELS_FIGURE, "pdf"));
        document.figure(Figure { file, print, is_wide: true, caption });
    }
    let rows = model_rows(found)
        .into_iter()
        .map(|(what, values)| std::iter::once(Cell::text(what)).chain(values.into_iter().map(Cell::text)).collect());
    let names: Vec<String> = std::iter::once(String::new()).chain(titles).collect();
    let caption = format!("Density fields at {}³ places, scene {}{adapter}.", found.settings.places, found.scene);
    document.table(Table::with_names(caption, names, rows));
    let rows = found.pictures.iter().map(|picture| {
        vec![
            Cell::text(picture.light_title.clone()),
            Cell::text(picture.density.clone()),
            Cell::Number(Some(picture.mean_radiance)),
            Cell::Number(picture.bias.map(|bias| 100.0 * bias)),
            Cell::Number(Some(picture.seconds)),
        ]
    });
    let heads = [("Light", ""), ("Density", ""), ("Mean radiance", ""), ("Against path tracing", "%"), ("Time", "s")];
    let caption = format!(
        "Pictures of the densities under each light model, scene {}; path tracing: {} samples per pixel.",
        found.scene, found.settings.samples
    );
    document.table(Table::new(caption, &heads, rows));
}

fn with_extension(file: &str, extension: &str) -> String {
    std::path::Path::new(file).with_extension(extension).display().to_string()
}
