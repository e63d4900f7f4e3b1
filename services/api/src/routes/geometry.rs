//! Geometry of a vehicle: rotors with positions and spins, the effect of each of them, and its hover. For drawings.

use super::jobs::Shared;
use crate::access::Caller;
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_plant::vehicle::model::{SpinDirection, geometry};
use rotortwin_scenario::VehicleDocuments;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Rows of the effectiveness matrix.
const ROWS: [&str; 4] = ["thrust", "roll", "pitch", "yaw"];
/// Where nothing else is said, a vehicle hovers with a full battery.
const FULL: f64 = 1.0;

/// The geometry of a vehicle document; x forward, y right, z down, from the centre of mass.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct VehicleGeometry {
    /// Name of the vehicle.
    name: String,
    /// kg.
    mass_kg: f64,
    /// Distance to the farthest rotor, m.
    arm_m: f64,
    /// m/s².
    gravity_m_s2: f64,
    /// Principal moments of inertia, kg m².
    inertia_body_kg_m2: [f64; 3],
    /// Ordered by number.
    rotors: Vec<RotorView>,
    /// Effect of the thrusts.
    effectiveness: Effectiveness,
    /// Hover in still air; absent if the battery cannot lift the vehicle.
    hover: Option<Hover>,
}

/// One rotor.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct RotorView {
    /// From 1.
    number: usize,
    /// m.
    position_body_m: [f64; 3],
    /// Rotation sense, seen from above.
    spin: SpinView,
    /// Drag torque per thrust, m.
    moment_ratio_m: f64,
}

/// Rotation sense, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SpinView {
    Cw,
    Ccw,
}

/// `matrix` times the rotors' thrusts (N): total thrust (N), then torques about x, y, z (N m).
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Effectiveness {
    /// `thrust`, `roll`, `pitch`, `yaw`.
    rows: [&'static str; 4],
    /// One row for each of these, one column per rotor.
    matrix: [Vec<f64>; 4],
}

/// Hover in still air.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Hover {
    /// Weight, N.
    thrust_n: f64,
    /// Minimum-norm thrusts that carry the weight without torque, N.
    rotor_thrust_n: Vec<f64>,
    /// Duties for these thrusts at that voltage, fraction.
    duty: Vec<f64>,
    /// State of charge, fraction.
    state_of_charge: f64,
    /// Battery voltage under this load, V.
    voltage_v: f64,
}

impl VehicleGeometry {
    /// # Errors
    /// 422: a layout that no flight code takes.
    fn of(documents: &VehicleDocuments, charge: f64) -> Result<Self, Problem> {
        let vehicle = &documents.vehicle;
        let placements = vehicle.rotors.layout.placements();
        let distance = |[x, y, _]: [f64; 3]| x.hypot(y);
        let arms = vehicle.rotors.layout.torque_arms();
        let torque = |axis: usize| arms.iter().map(|arm| arm[axis]).collect();
        let rotors = placements.iter().enumerate().map(|(place, rotor)| RotorView {
            number: place + 1,
            position_body_m: rotor.position_body,
            spin: match rotor.spin {
                SpinDirection::Cw => SpinView::Cw,
                SpinDirection::Ccw => SpinView::Ccw,
            },
            moment_ratio_m: rotor.moment_ratio,
        });
        Ok(Self {
            name: vehicle.name.clone(),
            mass_kg: vehicle.body.mass_kg,
            arm_m: placements.iter().map(|p| distance(p.position_body)).fold(0.0, f64::max),
            gravity_m_s2: vehicle.body.gravity_m_s2,
            inertia_body_kg_m2: vehicle.body.inertia_body_kg_m2,
            rotors: rotors.collect(),
            effectiveness: Effectiveness {
                rows: ROWS,
                matrix: [vec![1.0; placements.len()], torque(0), torque(1), torque(2)],
            },
            hover: hover(documents, charge)?,
        })
    }
}

fn hover(documents: &VehicleDocuments, charge: f64) -> Result<Option<Hover>, Problem> {
    let vehicle = &documents.vehicle;
    let placements = vehicle.rotors.layout.placements();
    let layout = geometry(&placements).map_err(Problem::unprocessable)?;
    let weight = vehicle.body.mass_kg * vehicle.body.gravity_m_s2;
    let thrust: Vec<f64> = layout.allocate([-weight as f32, 0.0, 0.0, 0.0])[..placements.len()]
        .iter()
        .map(|thrust| f64::from(*thrust))
        .collect();
    let battery = Battery::new(&vehicle.battery);
    // Momentum theory: P ∝ Σ T^(3/2), as the battery model has it.
    let power = battery.power_coefficient() * thrust.iter().map(|thrust| thrust.powf(1.5)).sum::<f64>();
    let voltage = battery.output(charge, power).battery_voltage;
    let blade = documents.nominal_blade();
    let duty: Option<Vec<f64>> = thrust.iter().map(|thrust| blade.duty(*thrust, voltage)).collect();
    Ok(duty.map(|duty| Hover {
        thrust_n: weight,
        rotor_thrust_n: thrust,
        duty,
        state_of_charge: charge,
        voltage_v: voltage,
    }))
}

/// What a vehicle of the library looks like.
#[utoipa::path(get, path = "/api/v1/vehicles/{name}/geometry", tag = "library", operation_id = "vehicle_geometry", params(("name" = String, Path)), responses(
    (status = 200, description = "the geometry", body = VehicleGeometry),
    (status = 400, description = "invalid name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document is invalid", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn of_vehicle(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
) -> Result<Json<VehicleGeometry>, Problem> {
    let Path(name) = name?;
    let library = app.library(&caller).await?;
    let seen = || VehicleGeometry::of(&library.vehicle_documents(&name)?, FULL);
    app.readers.read(seen).await.map(Json)
}

/// What the vehicle of a run looks like.
#[utoipa::path(get, path = "/api/v1/runs/{id}/geometry", tag = "runs", operation_id = "run_geometry", params(("id" = String, Path)), responses(
    (status = 200, description = "the geometry; hover at the initial charge of the run", body = VehicleGeometry),
    (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "run not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "this version cannot fly the scenario", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn of_run(
    app: Shared,
    caller: Caller,
    id: Result<Path<String>, PathRejection>,
) -> Result<Json<VehicleGeometry>, Problem> {
    let run = super::runs::find(&app, &caller, id).await?;
    let scenario = app
        .readers
        .read(|| super::submissions::recorded(&super::runs::flight_of(&run)?))
        .await?;
    let documents = VehicleDocuments {
        vehicle: scenario.vehicle().clone(),
        blades: scenario.blades().clone(),
    };
    VehicleGeometry::of(&documents, scenario.simulation_config().state_of_charge).map(Json)
}

/// Which version.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct At {
    /// `v1`, or a branch; `main` without it.
    at: Option<String>,
}

/// What the vehicle of a model looks like, without its effects.
#[utoipa::path(get, path = "/api/v1/models/{name}/geometry", tag = "models", operation_id = "model_geometry", params(("name" = String, Path), At), responses(
    (status = 200, description = "the geometry", body = VehicleGeometry),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model or version not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document is invalid", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn of_model(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
    at: Result<Query<At>, QueryRejection>,
) -> Result<Json<VehicleGeometry>, Problem> {
    let (Path(name), Query(At { at })) = (name?, at?);
    let version = app
        .model_version(&caller, &name, at.as_deref().unwrap_or("main"))
        .await?;
    VehicleGeometry::of(&version.documents(), FULL).map(Json)
}
