/// Drivers of haptic devices as plug-ins: a shared library that `palpate explore --device plugin=FILE` loads.
///
/// A plug-in exports plp_driver_v1() and links nothing of palpate. docs/guide/plug-ins.md starts with an
/// example.
///
/// palpate runs a plug-in in a separate process. If it crashes, hangs or reports implausible values, that
/// process is terminated: the session continues without force from the device and reports the reason.
///
/// Units and frame. Lengths are mm, forces N, torques N mm about the tip, angles rad, times s. Positions and
/// forces are in the device's own axes, which plp_driver_device::axes maps to World (+x right, +y forward, +z
/// up). An unknown value is NaN, never 0.
///
/// Threads. plp_driver_v1, open, read, write and close are called by one thread, halt by another one at any
/// time, also while read or write hangs.
#ifndef PALPATE_DRIVER_H
#define PALPATE_DRIVER_H

#include <stdint.h>

#if defined(__GNUC__)
#define PLP_DRIVER_EXPORT __attribute__((visibility("default")))
#else
#define PLP_DRIVER_EXPORT
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define PLP_DRIVER_MAX_DEVICES 4

/// Properties of a device. palpate initialises all numbers to NaN (unknown) and `axes` to the identity.
typedef struct plp_driver_device {
  uint32_t size;                   ///< Set by palpate; must not change
  int32_t degrees_of_freedom_in;   ///< 3 by default
  int32_t degrees_of_freedom_out;  ///< 3 by default; 0: no force
  int32_t buttons;                 ///< Number of buttons, 0 ... 32
  int32_t has_gripper;             ///< 0 or 1
  int32_t moves_by_itself;         ///< 1: calibration moves the arm, which requires the user's consent
  char name[64];                   ///< Identity that distinguishes devices of one kind; UTF-8
  double axes[9];                  ///< Rotation, by rows: column n is the device's axis n in World
  double peak_force_N, continuous_force_N;
  double peak_torque_Nmm;
  double peak_gripper_N;
  double position_step_mm;            ///< Encoder resolution
  double stiffness_N_per_mm;          ///< Maximum stiffness by the vendor; NaN: a conservative bound applies
  double delay_s;                     ///< From a command to its force
  double mass_kg, damping_N_s_per_m;  ///< Effective, of the arm at the tip
  double workspace_low_mm[3], workspace_high_mm[3];  ///< Reachable box
} plp_driver_device;

/// State of a device. palpate passes in the previous sample; leave members that the device does not report
/// unchanged: velocities and gripper are then NaN, the orientation is the identity.
typedef struct plp_driver_sample {
  uint32_t size;     ///< Set by palpate; must not change
  uint32_t buttons;  ///< Bit n: button n is held
  int32_t fault;     ///< 1: the device itself withholds force or pose (brake, switch, lost cable)
  int32_t reserved;  ///< 0
  double tip_mm[3];
  double orientation_wxyz[4];  ///< Unit quaternion from the tool's axes to the device's
  double velocity_mm_s[3], angular_velocity_rad_s[3];
  double gripper_rad;
  /// Age of the pose when read() returns, s; the largest possible age if it is not known exactly. Above 5 ms
  /// the force fades out. 0 by default.
  double age_s;
} plp_driver_sample;

/// Force and torque on the hand.
typedef struct plp_driver_command {
  uint32_t size;
  uint32_t reserved;
  double force_N[3];
  double torque_Nmm[3];
  double gripper_N;  ///< Positive: opens the gripper
} plp_driver_command;

/// A driver: its devices and functions, filled in by plp_driver_v1().
typedef struct plp_driver {
  uint32_t size;          ///< Set by palpate: sizeof(plp_driver) of its version
  uint32_t device_count;  ///< 1 ... PLP_DRIVER_MAX_DEVICES; 1 by default
  plp_driver_device devices[PLP_DRIVER_MAX_DEVICES];
  void* context;  ///< First argument of every function
  /// Connects and calibrates, within 30 s. 0: the devices are ready. Otherwise `error` receives the reason
  /// for the user, a text of at most `error_size` bytes with its final zero.
  /// @param may_move  1: the user has agreed that the arm moves by itself
  /// @param devices   properties that are known only once connected may be updated
  int32_t (*open)(void* context, int32_t may_move, plp_driver_device* devices, char* error,
                  uint32_t error_size);
  /// Reads the devices' states, `device_count` of them. Returns 0 on success; otherwise the force is off
  /// until a read succeeds.
  int32_t (*read)(void* context, plp_driver_sample* samples);
  /// Sends forces, `device_count` of them. Returns 0 on success; otherwise halt() is called.
  int32_t (*write)(void* context, const plp_driver_command* commands);
  /// Switches the force off by the device's own means, until the next write(). Never waits for read() or
  /// write().
  void (*halt)(void* context);
  /// Disconnects, at zero force.
  void (*close)(void* context);
} plp_driver;

/// The one function that a plug-in exports: fills in the driver without connecting to a device. Returns 0 on
/// success.
PLP_DRIVER_EXPORT int32_t plp_driver_v1(plp_driver* driver);

#ifdef __cplusplus
}
#endif

#endif  // PALPATE_DRIVER_H
