//! The media of a scene in full: every closure, every object, for integrators that trace paths.
//!
//! An [`ObjectMedium`] is the sum of closures in one object. One program computes what varies; a closure whose
//! inputs are constant but for the density costs one product per coefficient. Where objects overlap their
//! coefficients add and their lobes stand side by side ([`Media`]).
//!
//! Lengths are metres of world space, whatever the object's scale; positions are in the object's frame.

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::graph::bounds::Bounds3;
use crate::graph::closures::{Closure, ClosureSum, Factor, Value};
use crate::graph::evaluate::Points;
use crate::graph::{Operand, Program};
use crate::media::density::Density;
use crate::media::mesh::{Mesh, PlacedMesh, as_box};
use crate::media::phase::{PhaseFunction, ScatteringLobe};
use crate::media::region::Region;
use crate::nodes::closure::{Coefficients, Phase, Quantity, per_channel};
use crate::nodes::density_medium::DensityMedium;
use crate::nodes::{Interval, Mode, density_medium};
use crate::scene::{self, Graph, Scene, Shape, Volume, check_mesh};
use glam::{DMat4, DVec3};
use std::collections::HashMap;
use std::sync::Arc;

/// The medium of one object.
pub struct ObjectMedium {
    /// The object's name.
    pub object: String,
    /// World to object.
    pub to_object: DMat4,
    /// The box that it fills, in the object's frame, or the box around the mesh that it fills.
    pub bounds: Region,
    /// The mesh that it fills, if it does not fill its box.
    pub mesh: Option<Arc<PlacedMesh>>,
    /// What is known of it without evaluating.
    pub character: Character,
    program: Arc<Program>,
    terms: Vec<Term>,
}

/// What is known of a medium without evaluating it. A false statement only means that it is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Character {
    /// All coefficients are the same everywhere.
    pub homogeneous: bool,
    /// Extinction and scattering are the same in all channels.
    pub grey: bool,
    /// Whatever scatters does so alike in all directions.
    pub isotropic: bool,
    /// Nothing is emitted.
    pub dark: bool,
    /// Nothing is scattered.
    pub absorbing: bool,
}

/// A closure with what could be computed beforehand.
struct Term {
    closure: Closure,
    /// Factor on all coefficients: a Volume object's are per length of its own.
    scale: f64,
    /// The phase function, where it is the same everywhere.
    phase: Option<PhaseFunction>,
    /// The coefficients where only the density varies.
    scaled: Option<Scaled>,
}

/// Scattering and extinction per unit density, and the emission, which does not depend on it.
struct Scaled {
    unit: Coefficients<f64>,
    density: Value,
}

/// A lobe of a phase mixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobe {
    /// Scattering coefficient per channel, 1/m.
    pub scattering: [f64; 3],
    /// How it scatters.
    pub phase: PhaseFunction,
}

/// The lobes at a point. They mix in proportion to the mean of their scattering over the channels.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseMixture {
    lobes: Vec<Lobe>,
}

/// What a medium's program gave for a batch of points.
pub struct Values<'m> {
    medium: &'m ObjectMedium,
    rows: Vec<f64>,
}

/// Closures have at most this many input components (Principled Volume: 17).
const MOST_INPUTS: usize = 24;

impl Value {
    /// The component, given the program's results at a point.
    fn at<Q: Quantity>(self, row: &[Q]) -> Q {
        match self {
            Self::Constant(value) => Q::of(f64::from(value)),
            Self::Column(column) => row[column],
        }
    }
}

/// Interval of a value; an f32 constant is itself, without pad.
fn interval_of(value: Value, row: &[Interval]) -> Interval {
    match value {
        Value::Constant(value) => Interval::point(value),
        Value::Column(column) => row[column],
    }
}

impl Term {
    fn new(closure: Closure, scale: f64) -> Self {
        // NaN in place of what varies: what still comes out as a number does not depend on it.
        let known = |value: &Value| match value {
            Value::Constant(value) => f64::from(*value),
            Value::Column(_) => f64::NAN,
        };
        let mut inputs: Vec<f64> = closure.inputs.iter().map(known).collect();
        let phase = closure.formula.phase(&inputs).filter(Phase::is_known).map(PhaseFunction::new);
        let density = closure.input("Density").map_or(Value::Constant(1.0), |index| {
            inputs[index] = 1.0;
            closure.inputs[index]
        });
        let scaled = (!inputs.iter().any(|input| input.is_nan()))
            .then(|| Scaled { unit: closure.formula.coefficients(&inputs), density });
        Self { closure, scale, phase, scaled }
    }

    /// Product of the factors of the mixes.
    fn weight(&self, row: &[f64]) -> f64 {
        let part = |factor: &Factor| {
            let share = factor.value.at(row).limited(0.0, 1.0);
            if factor.complement { 1.0 - share } else { share }
        };
        self.closure.factors.iter().map(part).fold(self.scale, |product, factor| product * factor)
    }

    /// Calls `function` with the closure's inputs at a point.
    fn with_inputs<T>(&self, row: &[f64], function: impl FnOnce(&[f64]) -> T) -> T {
        let mut inputs = [0.0; MOST_INPUTS];
        let inputs = &mut inputs[..self.closure.inputs.len()];
        for (input, value) in inputs.iter_mut().zip(&self.closure.inputs) {
            *input = value.at(row);
        }
        function(inputs)
    }

    fn coefficients(&self, row: &[f64]) -> Coefficients<f64> {
        let weight = self.weight(row);
        if let Some(Scaled { unit, density }) = &self.scaled {
            let amount = weight * density.at(row).positive_part();
            return Coefficients {
                scattering: unit.scattering.mapped(|value| value * amount),
                extinction: unit.extinction.mapped(|value| value * amount),
                emission: unit.emission.mapped(|value| value * weight),
            };
        }
        let found = self.with_inputs(row, |inputs| self.closure.formula.coefficients(inputs));
        Coefficients {
            scattering: found.scattering.mapped(|value| value * weight),
            extinction: found.extinction.mapped(|value| value * weight),
            emission: found.emission.mapped(|value| value * weight),
        }
    }

    fn bounds(&self, row: &[Interval]) -> Coefficients<Interval> {
        let weight = self.closure.factors.iter().fold(Interval::of(self.scale), |product, factor| {
            let share = interval_of(factor.value, row).limited(0.0, 1.0);
            product * if factor.complement { (Interval::ONE - share).limited(0.0, 1.0) } else { share }
        });
        if let Some(Scaled { unit, density }) = &self.scaled {
            let amount = weight * interval_of(*density, row).positive_part();
            return Coefficients {
                scattering: unit.scattering.mapped(|value| amount * Interval::of(value)),
                extinction: unit.extinction.mapped(|value| amount * Interval::of(value)),
                emission: unit.emission.mapped(|value| weight * Interval::of(value)),
            };
        }
        let inputs: Vec<Interval> = self.closure.inputs.iter().map(|&value| interval_of(value, row)).collect();
        let found = self.closure.formula.bounds(&inputs);
        Coefficients {
            scattering: found.scattering.mapped(|value| value * weight),
            extinction: found.extinction.mapped(|value| value * weight),
            emission: found.emission.mapped(|value| value * weight),
        }
    }

    fn phase(&self, row: &[f64]) -> Option<PhaseFunction> {
        self.phase.or_else(|| {
            let phase = self.with_inputs(row, |inputs| self.closure.formula.phase(inputs));
            phase.map(PhaseFunction::new)
        })
    }

    /// Whether the three components of every colour are one value, and nothing else brings colour in.
    fn is_grey(&self) -> bool {
        if let Some(Scaled { unit, .. }) = &self.scaled {
            let same = |values: [f64; 3]| values[0] == values[1] && values[1] == values[2];
            return same(unit.scattering) && same(unit.extinction);
        }
        let mut first = 0;
        self.closure.node_type.inputs_of(&self.closure.mode).all(|socket| {
            let values = &self.closure.inputs[first..first + socket.kind.components()];
            first += values.len();
            values.iter().all(|value| value == &values[0])
        })
    }
}

impl Phase {
    /// Whether no parameter is NaN.
    fn is_known(&self) -> bool {
        let parameters = match *self {
            Self::Rayleigh => [0.0; 2],
            Self::HenyeyGreenstein { anisotropy } => [anisotropy, 0.0],
            Self::Draine { anisotropy, alpha } => [anisotropy, alpha],
            Self::FournierForand { ior, backscatter } => [ior, backscatter],
            Self::Mie { diameter } => [diameter, 0.0],
        };
        !parameters.iter().any(|parameter| parameter.is_nan())
    }
}

impl ObjectMedium {
    /// Compiles the medium of an object.
    pub fn new(graph: &Graph, volume: &Volume) -> Result<Self> {
        let (bounds, mesh) = outline_of(volume)?;
        let ClosureSum { program, closures } = ClosureSum::compile(graph, volume)?;
        let to_object = scene::matrix_to_glam(&volume.matrix_world).inverse();
        let program = Arc::new(program);
        let medium = Self::of_closures(&volume.object, to_object, bounds, program, closures, length_scale(volume));
        Ok(Self { mesh, ..medium })
    }

    /// The same medium in a mesh of its frame instead of its box.
    pub fn in_mesh(self, mesh: Option<Arc<PlacedMesh>>) -> Self {
        Self { mesh, ..self }
    }

    /// The medium of a density in a box: extinction and scattering per unit of density and metre, and the lobes of its phase function,
    /// each a share of the scattering, an anisotropy and
    /// Draine's alpha. It scatters and absorbs, and emits nothing.
    pub fn of_density(
        name: &str,
        to_object: DMat4,
        density: &Density,
        extinction: [f64; 3],
        scattering: [f64; 3],
        lobes: &[ScatteringLobe],
    ) -> Self {
        let label = || format!("medium of {name}");
        let closure = |extinction: [f64; 3], scattering: [f64; 3], [anisotropy, alpha]: [f64; 2]| Closure {
            label: label(),
            node_type: &density_medium::TYPE,
            mode: Mode::of_data(&density_medium::TYPE, Vec::new()),
            formula: DensityMedium { extinction, scattering, anisotropy, alpha }.boxed(),
            inputs: vec![match density.program().outputs[0].operands[0] {
                Operand::Constant(value) => Value::Constant(value),
                _ => Value::Column(0),
            }],
            factors: Vec::new(),
        };
        let absorbed = each(|channel| (extinction[channel] - scattering[channel]).max(0.0));
        let mut closures = Vec::new();
        if absorbed != [0.0; 3] {
            closures.push(closure(absorbed, [0.0; 3], [0.0; 2]));
        }
        for &ScatteringLobe { share, anisotropy, alpha } in lobes {
            let part = scattering.mapped(|channel| share * channel);
            closures.push(closure(part, part, [anisotropy, alpha]));
        }
        let program = match closures.first().map(|closure| closure.inputs[0]) {
            Some(Value::Column(_)) => Arc::clone(density.program()),
            _ => Arc::new(Program { outputs: Vec::new(), ..Program::constant("nothing", 0.0) }),
        };
        Self::of_closures(name, to_object, density.bounds, program, closures, 1.0)
    }

    fn of_closures(
        object: &str,
        to_object: DMat4,
        bounds: Region,
        program: Arc<Program>,
        closures: Vec<Closure>,
        scale: f64,
    ) -> Self {
        let terms: Vec<Term> = closures.into_iter().map(|closure| Term::new(closure, scale)).collect();
        let unknown = vec![Interval::EVERYTHING; program.output_components()];
        let all = sum(terms.iter().map(|term| term.bounds(&unknown)), Interval::ZERO);
        let zero = |values: [Interval; 3]| values.iter().all(|value| *value == Interval::ZERO);
        let absorbing = zero(all.scattering);
        let isotropic = |term: &Term| match &term.phase {
            Some(phase) => phase.is_isotropic() || zero(term.bounds(&unknown).scattering),
            // Without a phase function at any point, or with one that varies.
            None => zero(term.bounds(&unknown).scattering),
        };
        let character = Character {
            homogeneous: unknown.is_empty(),
            grey: terms.iter().all(Term::is_grey),
            isotropic: terms.iter().all(isotropic),
            dark: zero(all.emission),
            absorbing,
        };
        Self { object: object.to_owned(), to_object, bounds, mesh: None, character, program, terms }
    }

    /// Whether a place of the world is inside: of a mesh, by what is above it ([`PlacedMesh::begins_inside`]).
    pub fn holds(&self, place: DVec3) -> bool {
        if let Some(mesh) = &self.mesh {
            return mesh.begins_inside(place);
        }
        let local = self.to_object.transform_point3(place);
        local.cmpge(self.bounds.low).all() && local.cmple(self.bounds.high).all()
    }

    /// Its closures, with the factor on each one's coefficients.
    pub(crate) fn closures(&self) -> impl Iterator<Item = (&Closure, f64)> {
        self.terms.iter().map(|term| (&term.closure, term.scale))
    }

    /// The program that computes what varies, one output per column.
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Evaluates what varies at positions of the object's frame. Whether they are inside is not asked.
    pub fn evaluate(&self, positions: &[[f32; 3]]) -> Result<Values<'_>> {
        Ok(self.values(&self.program.evaluate_single(Points::new(positions))?))
    }

    /// What [`Self::program`] gave for a batch of points, point by point.
    pub fn values(&self, rows: &[f32]) -> Values<'_> {
        Values { medium: self, rows: rows.iter().copied().map(f64::from).collect() }
    }

    /// Coefficients where the only column of [`Self::program`] is 1, if they are proportional to it: one density varies and
    /// nothing else does. Emission does not depend on it. Without a column these are the coefficients everywhere.
    pub fn proportional(&self) -> Option<Coefficients<f64>> {
        let constant = |factor: &Factor| matches!(factor.value, Value::Constant(_));
        let fits = |term: &Term| {
            term.scaled.as_ref().is_some_and(|Scaled { unit, density }| {
                let filled = unit.scattering != [0.0; 3] || unit.extinction != [0.0; 3];
                term.closure.factors.iter().all(constant) && (*density == Value::Column(0) || !filled)
            })
        };
        let row: &[f64] = match self.program.output_components() {
            0 => &[],
            1 if self.terms.iter().all(fits) => &[1.0],
            _ => return None,
        };
        Some(sum(self.terms.iter().map(|term| term.coefficients(row)), 0.0))
    }

    /// The emission, radiance per metre, if it is the same everywhere.
    pub fn constant_emission(&self) -> Option<[f64; 3]> {
        // NaN in place of what varies: what still comes out as a number does not depend on it.
        let row = vec![f64::NAN; self.program.output_components()];
        let emission = sum(self.terms.iter().map(|term| term.coefficients(&row)), 0.0).emission;
        (!emission.iter().any(|channel| channel.is_nan())).then_some(emission)
    }

    /// The phase function of each closure that may scatter; none for one whose phase function varies.
    pub fn phases(&self) -> impl Iterator<Item = Option<PhaseFunction>> + '_ {
        let unknown = vec![Interval::EVERYTHING; self.program.output_components()];
        let scatters = move |term: &&Term| term.bounds(&unknown).scattering != [Interval::ZERO; 3];
        self.terms.iter().filter(scatters).map(|term| term.phase)
    }

    /// Encloses the coefficients over boxes of the object's frame, each divided `depth` times into eight to make
    /// the result narrower. Every value that [`Self::evaluate`] leads to lies within.
    pub fn bounds_of(&self, boxes: &[Bounds3], depth: u32) -> Result<Vec<Coefficients<Interval>>> {
        let width = self.program.output_components();
        let rows = self.program.bounds_refined(boxes, depth)?;
        Ok((0..boxes.len()).map(|index| self.enclosed(&rows[index * width..(index + 1) * width])).collect())
    }

    /// Encloses the coefficients where the columns of [`Self::program`] lie within intervals.
    pub fn enclosed(&self, row: &[Interval]) -> Coefficients<Interval> {
        sum(self.terms.iter().map(|term| term.bounds(row)), Interval::ZERO)
    }
}

/// Sum of coefficients, term by term.
fn sum<Q: Quantity>(terms: impl Iterator<Item = Coefficients<Q>>, zero: Q) -> Coefficients<Q> {
    let nothing = Coefficients { scattering: [zero; 3], extinction: [zero; 3], emission: [zero; 3] };
    terms
        .fold(None, |known: Option<Coefficients<Q>>, term| {
            let add = |a: [Q; 3], b: [Q; 3]| per_channel(|channel| a[channel] + b[channel]);
            Some(match known {
                None => term,
                Some(known) => Coefficients {
                    scattering: add(known.scattering, term.scattering),
                    extinction: add(known.extinction, term.extinction),
                    emission: add(known.emission, term.emission),
                },
            })
        })
        .unwrap_or(nothing)
}

/// Coefficients of the medium in world space over those of its closures. A mesh's are per metre of world space. Those of a Volume
/// object are per metre of its own: Cycles 5.0 divides them by the length to which the object takes the unit vector along
/// (1, 1, 1), in all directions alike (measured; docs/volume-objects.md).
pub(crate) fn length_scale(volume: &Volume) -> f64 {
    match volume.shape {
        Shape::Grid { .. } => {
            let diagonal = DVec3::ONE.normalize();
            1.0 / scene::matrix_to_glam(&volume.matrix_world).transform_vector3(diagonal).length()
        }
        Shape::Box | Shape::Mesh { .. } => 1.0,
    }
}

/// The box that a volume fills, or the box around the mesh that it fills, and that mesh. A mesh that is a box up to rounding counts as one.
pub(crate) fn outline_of(volume: &Volume) -> Result<(Region, Option<Arc<PlacedMesh>>)> {
    if let Shape::Mesh { vertices, triangles } = &volume.shape {
        let place = format!("object {}: shape", volume.object);
        check_mesh(&place, vertices, triangles)?;
        if let Some(region) = as_box(vertices, triangles) {
            return Ok((region, None));
        }
        let mesh = Mesh::new(&place, vertices, triangles)?;
        if !mesh.is_closed() {
            log::warn!("{place}: the mesh is not closed, and its medium is cut off at the box around it");
        } else if mesh.volume() < 0.0 {
            log::warn!("{place}: the faces of the mesh look inward, so that it holds no medium for rays from outside");
        }
        let to_object = scene::matrix_to_glam(&volume.matrix_world).inverse();
        return Ok((mesh.bounds(), Some(Arc::new(PlacedMesh::new(mesh, to_object)))));
    }
    let corner = |corner: [f32; 3]| DVec3::from(corner.mapped(f64::from));
    Ok((Region { low: corner(volume.bounds.min), high: corner(volume.bounds.max) }, None))
}

impl Values<'_> {
    fn row(&self, index: usize) -> &[f64] {
        let width = self.medium.program.output_components();
        &self.rows[index * width..(index + 1) * width]
    }

    /// Coefficients at a point of the batch, as they are: NaN and negative extinction are for the caller to see.
    pub fn coefficients(&self, index: usize) -> Coefficients<f64> {
        let row = self.row(index);
        sum(self.medium.terms.iter().map(|term| term.coefficients(row)), 0.0)
    }

    /// [`Self::coefficients`], with an error that names the point where they make no sense: NaN, infinity, or a
    /// negative extinction.
    pub fn checked(&self, index: usize, position: [f32; 3]) -> Result<Coefficients<f64>> {
        let found = self.coefficients(index);
        let finite = [found.scattering, found.extinction, found.emission].as_flattened().iter().all(|x| x.is_finite());
        if finite && found.extinction.iter().all(|&value| value >= 0.0) {
            return Ok(found);
        }
        Err(Error::new(
            format!("object {}, object-space position {position:?}", self.medium.object),
            format!(
                "scattering {:?}, extinction {:?}, emission {:?}",
                found.scattering, found.extinction, found.emission
            ),
            "finite coefficients, extinction at least 0",
            "Keep densities finite and colours of absorption within [0, 1].",
        ))
    }

    /// The lobes at a point of the batch.
    pub fn mixture(&self, index: usize) -> PhaseMixture {
        let mut mixture = PhaseMixture { lobes: Vec::with_capacity(self.medium.terms.len()) };
        let row = self.row(index);
        for term in &self.medium.terms {
            let scattering = term.coefficients(row).scattering;
            if scattering != [0.0; 3]
                && let Some(phase) = term.phase(row)
            {
                mixture.lobes.push(Lobe { scattering, phase });
            }
        }
        mixture
    }
}

impl PhaseMixture {
    /// No lobe: nothing scatters.
    pub fn empty() -> Self {
        Self { lobes: Vec::new() }
    }

    /// The lobes.
    pub fn lobes(&self) -> &[Lobe] {
        &self.lobes
    }

    /// Adds the lobes of a medium that overlaps.
    pub fn append(&mut self, mut other: Self) {
        self.lobes.append(&mut other.lobes);
    }

    /// Phase function in 1/sr for the cosine between the directions of travel before and after, the same for all
    /// channels; 0 where nothing scatters. It is also the density of [`Self::sample`] over solid angle.
    ///
    /// Lobes count by the mean of their channels, as Cycles 5.0.1 does (measured with a delta light): where lobes
    /// differ in colour, exact transport would mix them in each channel by that channel's scattering.
    pub fn evaluate(&self, cosine: f64) -> f64 {
        self.lobes.iter().zip(self.shares()).map(|(lobe, share)| share * lobe.phase.evaluate(cosine)).sum()
    }

    /// Part of each lobe.
    fn shares(&self) -> impl Iterator<Item = f64> + '_ {
        let amount = |lobe: &Lobe| lobe.scattering.iter().sum::<f64>();
        let total: f64 = self.lobes.iter().map(amount).sum();
        self.lobes.iter().map(move |lobe| amount(lobe) / total)
    }

    /// Samples a cosine with a number uniform in [0, 1): a lobe by its share, then its phase function. None where
    /// nothing scatters.
    pub fn sample(&self, uniform: f64) -> Option<f64> {
        let mut rest = uniform;
        for (lobe, share) in self.lobes.iter().zip(self.shares()) {
            if rest < share {
                return Some(lobe.phase.sample(rest / share));
            }
            rest -= share;
        }
        // Rounding can leave a rest behind the last lobe.
        self.lobes.last().map(|lobe| lobe.phase.sample(1.0 - f64::EPSILON))
    }
}

/// All media of a scene.
pub struct Media {
    /// Object by object.
    pub objects: Vec<Arc<ObjectMedium>>,
}

/// Coefficients and lobes at a point of the world.
#[derive(Debug, Clone, PartialEq)]
pub struct MediumAtPoint {
    /// Sums over the objects that hold the point.
    pub coefficients: Coefficients<f64>,
    /// All their lobes.
    pub mixture: PhaseMixture,
}

impl Media {
    /// Compiles the media of all volume objects.
    pub fn new(scene: &Scene) -> Result<Self> {
        let mut programs: HashMap<String, Arc<Program>> = HashMap::new();
        let objects = scene
            .volumes()?
            .into_iter()
            .map(|(volume, graph)| {
                let mut medium = ObjectMedium::new(graph, volume)?;
                // Objects whose programs are the same share one, so that what lies in many of them is evaluated at once. Those of a grid
                // read it, and stay by themselves.
                if volume.grid.is_none() {
                    let known = programs.entry(medium.program.content_hash());
                    medium.program = Arc::clone(known.or_insert_with(|| Arc::clone(&medium.program)));
                }
                Ok(Arc::new(medium))
            })
            .collect::<Result<_>>()?;
        Ok(Self { objects })
    }

    /// What is at positions of the world; faces of boxes count as inside.
    pub fn evaluate(&self, positions: &[DVec3]) -> Result<Vec<MediumAtPoint>> {
        let zero = Coefficients { scattering: [0.0; 3], extinction: [0.0; 3], emission: [0.0; 3] };
        let mut places = vec![MediumAtPoint { coefficients: zero, mixture: PhaseMixture::empty() }; positions.len()];
        for medium in &self.objects {
            let local = |position: DVec3| medium.to_object.transform_point3(position).as_vec3().to_array();
            let inside: Vec<(usize, [f32; 3])> = positions
                .iter()
                .enumerate()
                .filter(|(_, place)| medium.holds(**place))
                .map(|(index, place)| (index, local(*place)))
                .collect();
            let local: Vec<[f32; 3]> = inside.iter().map(|(_, place)| *place).collect();
            let values = medium.evaluate(&local)?;
            for (number, &(index, position)) in inside.iter().enumerate() {
                let place = &mut places[index];
                let found = values.checked(number, position)?;
                place.coefficients = sum([place.coefficients, found].into_iter(), 0.0);
                place.mixture.append(values.mixture(number));
            }
        }
        Ok(places)
    }
}
