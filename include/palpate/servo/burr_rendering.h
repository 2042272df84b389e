#pragma once

#include "palpate/contact/model.h"
#include "palpate/servo/servo_settings.h"
#include "palpate/tissue/removal.h"

/// Vibration, tangential kick and heating of a burr, from the state of its cutting. The laws and their
/// sources are in docs/decisions/0091-vibration-of-a-burr.md.
namespace palpate {

/// State of a burr's rendering between two ticks. All zero while the motor is off, except for the temperature
/// rise and the time for which a break-through is still reported.
struct BurrRenderingState {
  double frequency_hz = 0;     ///< Frequency of the vibration since the motor's start; 0: motor off
  double phase = 0;            ///< Phase of the vibration in periods, 0 ... 1
  double mean_N = 0;           ///< Low-pass filtered press force, from which the kick is computed
  double break_through_s = 0;  ///< Time for which a break-through is still reported
  double bone_rise_K = 0;      ///< Temperature rise of the bone at the head; 0 with irrigation
  /// Whether the material directly ahead of the head ends within kBurrRenderingSettings.free_mm
  bool is_wall_thin = false;

  bool is_used() const { return frequency_hz > 0 || break_through_s > 0 || bone_rise_K > 0 || is_wall_thin; }
};

/// Frequency of the rendered vibration, Hz: the rate at which the cutting edges pass, if the band contains
/// it; else the rotation rate, or the highest of its sub-harmonics 1/2, 1/3, ... in the band. The band ends
/// at kBurrRenderingSettings.max_hz, and at max_cycles_per_tick if the ticks are longer.
/// @param dt_s  duration of a tick, above 0
double vibration_hz(const BurrSettings& burr, double dt_s);

/// Amplitude of the force between a cutting burr and the material, in the patient, N: the cutting force
/// times e / (e + h), with the run-out e of the edges (kBurrRenderingSettings.runout_mm) and the depth of cut
/// h of one period of the highest real component of the vibration in the band (an edge's or a revolution's).
/// It increases with the press force and with the specific cutting energy, and never exceeds the cutting
/// force.
/// @param state  after the tick's cutting; 0 is returned if it cuts nothing
/// @param hz     vibration_hz()
double vibration_amplitude_N(const BurrSettings& burr, const BurrState& state, double hz);

/// Temperature rise after `dt_s` of a hemisphere of bone, of the head's radius, that receives a fraction of
/// the motor's work and conducts it into a half-space; K.
/// @param rise_K   rise before
/// @param work_mJ  work of the motor in that time, at least 0
double bone_rise_K(double rise_K, double radius_mm, double work_mJ, double dt_s);

}  // namespace palpate
