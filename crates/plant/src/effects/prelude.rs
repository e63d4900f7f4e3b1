//! What the file of an effect needs.

pub(super) use super::changes::Changes;
pub(super) use super::constants::Constants;
pub(super) use super::declaration::{
    Build, ChannelGroup, CorrectionScale, EffectClass, EffectDeclaration, ParameterDeclaration, Place, Setup,
};
pub(super) use super::hooks::{ActiveEffect, Hooks, Moment};
pub(super) use super::readings::Readings;
pub(super) use super::search::{AtBattery, BetweenRows, Requirement, Search, Shapes, Strategy, TrimChange, Wiring};
pub(super) use super::wrench::Wrench;
pub(super) use crate::random::NormalStream;
pub(super) use crate::vector::{Vector3, length};

pub(super) const FORCE: ChannelGroup = ChannelGroup::Force;
pub(super) const MOMENT: ChannelGroup = ChannelGroup::Moment;
pub(super) const VELOCITY: ChannelGroup = ChannelGroup::VelocityKinematics;
pub(super) const ATTITUDE: ChannelGroup = ChannelGroup::AttitudeKinematics;
pub(super) const POSITION: ChannelGroup = ChannelGroup::PositionKinematics;
pub(super) const VOLTAGE: ChannelGroup = ChannelGroup::Voltage;
