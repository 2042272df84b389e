/// C interface of palpate: models of segmented scans, and contact forces on tools.
///
/// Link libpalpate.so. docs/guide/c.md starts with an example program.
///
/// Units and frames. Lengths are mm, forces N, torques N mm about the tip, times s. Frames are those of
/// docs/concepts/conventions.md: Patient is LPS (+x to the patient's left, +y posterior, +z superior), World
/// is the workspace (+x right, +y forward, +z up, origin at the centre of the volume).
///
/// Errors. A function returns PLP_OK, or an error status without side effects; plp_last_error() then returns
/// the reason as text. No argument terminates the program: null pointers, non-finite numbers, sizes and
/// indices out of range, and handles of another type are errors. A destroyed handle must not be used.
///
/// Structs begin with their size. plp_X_init(&x, sizeof x) sets it and the defaults, so that a compiled
/// program stays compatible with a later library that appends members.
///
/// Threads. A model may be used by any number of threads, a session, run or recording by one at a time; each
/// function of a loop states its own rule. Functions with the same handle are otherwise independent.
#ifndef PALPATE_H
#define PALPATE_H

#include <stddef.h>
#include <stdint.h>

// ---- version

#define PLP_VERSION_MAJOR 1
#define PLP_VERSION_MINOR 0
#define PLP_VERSION_PATCH 0
#define PLP_VERSION "1.0.0"

#if defined(__GNUC__)
#define PLP_API __attribute__((visibility("default")))
#else
#define PLP_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/// Version of the library, e.g. "1.0.0"; PLP_VERSION is the version of the header. A program runs with any
/// library of its soname, libpalpate.so.1, that is not older than its header.
PLP_API const char* plp_version(void);

// ---- errors

typedef enum plp_status {
  PLP_OK = 0,
  PLP_BAD_INPUT = 1,      ///< Invalid argument, file or setting
  PLP_USAGE = 2,          ///< Inconsistent settings
  PLP_OUTPUT = 3,         ///< A file could not be written
  PLP_UNAVAILABLE = 4,    ///< A data set, a library or a thread is not available
  PLP_INTERRUPTED = 5,    ///< Cancelled through the flag of plp_set_cancel_flag()
  PLP_OUT_OF_MEMORY = 6,  ///< Nothing was changed
  PLP_INTERNAL = 7        ///< Internal error of the library
} plp_status;

/// Reason for the latest error of the calling thread: "where: what", and the remedy in a second line. Empty
/// before the first one. Valid until the thread's next error.
PLP_API const char* plp_last_error(void);

/// Lets another thread cancel the long calls of the calling thread: plp_model_create, plp_model_load,
/// plp_model_change, plp_model_cut, plp_model_sample and plp_simulate. They return PLP_INTERRUPTED, and
/// change nothing, soon after `*flag` has become 1.
/// @param flag  0 or 1, written by any thread and read without a lock until another flag is set; null: none,
///              the initial state of every thread
PLP_API void plp_set_cancel_flag(const uint8_t* flag);

// ---- values

/// Type of a voxel, or of a member of a struct.
typedef enum plp_type {
  PLP_UINT8 = 0,
  PLP_INT8 = 1,
  PLP_UINT16 = 2,
  PLP_INT16 = 3,
  PLP_UINT32 = 4,
  PLP_INT32 = 5,
  PLP_UINT64 = 6,
  PLP_INT64 = 7,
  PLP_FLOAT64 = 8,
  PLP_STRING = 9,   ///< const char*, UTF-8
  PLP_POINTER = 10  ///< Any other pointer
} plp_type;

/// Force method (docs/concepts/methods.md).
typedef enum plp_method {
  PLP_DEFAULT_METHOD = -1,  ///< The scene's; the proxy for a model from arrays
  PLP_TRILINEAR = 0,
  PLP_B_SPLINE = 1,
  PLP_GAUSSIAN_SPHERE = 2,
  PLP_SMOOTH_SPHERE = 3,
  PLP_STORED_NORMALS = 4,
  PLP_PROXY = 5
} plp_method;

/// Frame of input poses and output wrenches.
typedef enum plp_frame { PLP_WORLD = 0, PLP_PATIENT = 1 } plp_frame;

/// Bits of plp_record::flags that a host must handle; docs/reference/flags.md lists all bits.
typedef enum plp_flag {
  PLP_FLAG_CLAMPED = 1 << 0,     ///< The force exceeded the limit
  PLP_FLAG_NOT_FINITE = 1 << 1,  ///< A pose was not finite: the force was zero
  PLP_FLAG_OUTSIDE = 1 << 2,     ///< The tip is outside the volume
  PLP_FLAG_CONTACT = 1 << 4,     ///< A structure is in contact
  PLP_FLAG_RAMP = 1 << 8,        ///< The force was ramping in or out; the initial ramp takes 0.5 s
  PLP_FLAG_STALE = 1 << 9,       ///< The pose was older than 5 ms
  PLP_FLAG_JUMP = 1 << 10        ///< Implausible tip displacement within one tick: the force was zero
} plp_flag;

// ---- models

/// A segmented volume with the haptic properties of its structures, immutable. Versions share unchanged data.
typedef struct plp_model plp_model;

/// Label volume of any integer type and memory order. It is read during the call and not copied as a whole.
typedef struct plp_labels {
  uint32_t size;
  int32_t type;        ///< plp_type of a voxel, PLP_UINT8 ... PLP_INT64; values 0 (background) ... 65535
  const void* voxels;  ///< Voxel (0, 0, 0)
  int32_t dims[3];     ///< Voxels along i, j, k
  int32_t reserved;    ///< 0
  int64_t strides_bytes[3];  ///< From one voxel to the next along i, j, k; all 0: contiguous, i fastest
  double spacing_mm[3];      ///< Distance of voxel centres along i, j, k
  double direction[9];       ///< By rows; its columns are the unit vectors of i, j, k in Patient
  double origin_mm[3];       ///< Centre of voxel (0, 0, 0) in Patient
} plp_labels;
PLP_API plp_status plp_labels_init(plp_labels* labels, size_t size);

/// Haptic properties of structures (docs/guide/scene.md has their meaning and ranges).
typedef struct plp_tissue {
  uint32_t size;
  int32_t touchable;  ///< 0: displayed only
  const char* name;
  double stiffness_N_per_mm;
  double static_friction;  ///< At least `friction`
  double friction;         ///< Kinetic
  double viscosity_N_s_per_mm;
  double puncture_N;  ///< Normal force above which the tool punctures it; infinite: never
} plp_tissue;
PLP_API plp_status plp_tissue_init(plp_tissue* tissue, size_t size);

/// A label with its name and tissue.
typedef struct plp_structure {
  uint32_t size;
  uint32_t label;  ///< 1 ... 65535
  const char* name;
  int32_t tissue;  ///< Index into the tissues; -1: no tissue, so neither touchable nor displayed
  uint8_t rgb[3];
  uint8_t reserved;  ///< 0
} plp_structure;
PLP_API plp_status plp_structure_init(plp_structure* structure, size_t size);

/// Shape of an instrument, fixed in the tip's frame: at most 4 spheres and capsules.
typedef struct plp_tool {
  uint32_t size;
  uint32_t point_count;  ///< 0: one sphere at the tip
  const char* name;
  const double* points_mm;  ///< Sphere centres, 3 numbers each
  double radius_mm;         ///< Radius of every sphere; 0: points
  const double* capsules;   ///< 7 numbers each: both ends of the axis, and the radius; mm
  uint32_t capsule_count;
  uint32_t reserved;  ///< 0
} plp_tool;
PLP_API plp_status plp_tool_init(plp_tool* tool, size_t size);

typedef struct plp_model_options {
  uint32_t size;
  int32_t method;      ///< plp_method that the model is prepared for
  const char* title;   ///< May be null
  double max_force_N;  ///< Limit of the model; infinite: none
} plp_model_options;
PLP_API plp_status plp_model_options_init(plp_model_options* options, size_t size);

/// Makes a model from a label volume. A structure's label may be absent from the volume. Takes seconds.
/// @param tools    one for each device; none: a point
/// @param options  null: the defaults
PLP_API plp_status plp_model_create(const plp_labels* labels, const plp_tissue* tissues, size_t tissue_count,
                                    const plp_structure* structures, size_t structure_count,
                                    const plp_tool* tools, size_t tool_count,
                                    const plp_model_options* options, plp_model** model);
/// Loads a scene as `palpate` does: a data set ("knee-phantom:spacing=2"), a scene file or a volume. Prepared
/// data are cached on disk, as by `palpate` (docs/guide/cache.md).
/// @param segmentation  second of two volumes; null: none
/// @param options       null: the defaults. Title and force limit are the scene's own
PLP_API plp_status plp_model_load(const char* scene, const char* segmentation,
                                  const plp_model_options* options, plp_model** model);
/// Creates the next version of a model, with changed contact properties (stiffness, friction, viscosity) of
/// one tissue. Immediate for the proxy; for a direct method the field is recomputed.
PLP_API plp_status plp_model_change(const plp_model* model, size_t tissue, const plp_tissue* properties,
                                    plp_model** next);

/// Straight sweep of a ball whose swept volume is removed; in Patient.
typedef struct plp_cut {
  uint32_t size;
  uint32_t reserved;  ///< 0
  double from_mm[3], to_mm[3];
  double radius_mm;
} plp_cut;
PLP_API plp_status plp_cut_init(plp_cut* cut, size_t size);
/// Creates the next version of a model, without the swept volume. The model must be prepared for the proxy.
PLP_API plp_status plp_model_cut(const plp_model* model, const plp_cut* cuts, size_t count, plp_model** next);
/// Frees a model; sessions, loops and versions created from it stay valid. Null: no effect.
PLP_API void plp_model_destroy(plp_model* model);

typedef struct plp_model_info {
  uint32_t size;
  uint32_t version;
  uint64_t content_hash;                ///< Hash of all data that determine forces
  const char* title;                    ///< Valid as long as the model
  int32_t dims[3];                      ///< Voxels along i, j, k
  int32_t method;                       ///< Default plp_method of sessions
  double spacing_mm[3];                 ///< Along i, j, k
  double direction[9];                  ///< By rows; its columns are the unit vectors of i, j, k in Patient
  double origin_mm[3];                  ///< Centre of voxel (0, 0, 0) in Patient
  double world_patient[16];             ///< Rigid map from Patient to World; homogeneous, by rows
  double max_force_N;                   ///< Limit of the model; infinite: none
  uint32_t tissues, structures, tools;  ///< Counts
  uint32_t has_scan;                    ///< 0: labels only
} plp_model_info;
PLP_API plp_status plp_model_info_get(const plp_model* model, plp_model_info* info);
/// A tissue or structure; names are valid as long as the model.
PLP_API plp_status plp_model_tissue(const plp_model* model, size_t index, plp_tissue* tissue);
PLP_API plp_status plp_model_structure(const plp_model* model, size_t index, plp_structure* structure);

/// Samples the field of a method at points in Patient. Direct methods: value, 0 in free space to 1 deep in
/// the stiffest tissue, and gradient per mm. Proxy: signed distance to the nearest contact surface, mm,
/// negative inside and clamped to a few millimetres, and its gradient.
/// @param points_mm  3 * count numbers
/// @param values     count numbers
/// @param gradients  3 * count numbers; null: not returned
PLP_API plp_status plp_model_sample(const plp_model* model, int32_t method, const double* points_mm,
                                    size_t count, double* values, double* gradients);
/// Copies the labels, i fastest.
/// @param count  number of voxels
PLP_API plp_status plp_model_labels(const plp_model* model, uint16_t* voxels, size_t count);
/// The scan on the model's grid, i fastest, valid as long as the model. Error without a scan.
PLP_API plp_status plp_model_scan(const plp_model* model, const float** voxels, size_t* count);

// ---- pictures

/// A plane in Patient with a window of pixels on it.
typedef struct plp_section {
  uint32_t size;
  int32_t outlines;                ///< 0: no outlines
  int32_t width_px, height_px;     ///< 1 ... 4096
  double centre_mm[3];             ///< Centre of the picture
  double right[3], down[3];        ///< Unit vectors to the picture's right and bottom, orthogonal
  double width_mm;                 ///< Width of the picture
  double window_low, window_high;  ///< Scan values shown black and white; equal: 1st and 99th percentile
  double label_opacity;            ///< Opacity of the structures' colours over the scan, 0 ... 1
} plp_section;
/// The defaults are an axial section, 100 mm and 512 pixels wide.
PLP_API plp_status plp_section_init(plp_section* section, size_t size);
/// Draws scan and structures in a plane.
/// @param rgb    3 bytes for each pixel, row 0 at the top
/// @param bytes  3 * width_px * height_px
PLP_API plp_status plp_model_section(const plp_model* model, const plp_section* section, uint8_t* rgb,
                                     size_t bytes);
/// Label at each pixel of a plane; 0: none, or outside the volume.
/// @param count  width_px * height_px
PLP_API plp_status plp_model_section_labels(const plp_model* model, const plp_section* section,
                                            uint16_t* labels, size_t count);

/// A camera in Patient.
typedef struct plp_camera {
  uint32_t size;
  uint32_t reserved;            ///< 0
  int32_t width_px, height_px;  ///< 1 ... 4096
  double focus_mm[3];           ///< Centre of the picture
  double right[3], down[3];     ///< Unit vectors to the picture's right and bottom, orthogonal
  double width_mm;              ///< Width of the picture at the focus
  double eye_mm;                ///< Distance of the eye from the focus; infinite: parallel rays
} plp_camera;
/// The defaults are a view from the front by parallel rays, 200 mm and 512 pixels wide.
PLP_API plp_status plp_camera_init(plp_camera* camera, size_t size);
/// Draws the structures in three dimensions, without a graphics card.
/// @param rgb       3 bytes for each pixel, row 0 at the top
/// @param bytes     3 * width_px * height_px
/// @param depth_mm  width_px * height_px numbers: distance along the ray to the visible surface;
///                  infinite: none. Null: not returned
PLP_API plp_status plp_model_picture(const plp_model* model, const plp_camera* camera, uint8_t* rgb,
                                     size_t bytes, float* depth_mm);

// ---- sessions: the host ticks

/// Devices that touch a model, advanced by the host: no thread, no clock, and bitwise reproducible forces. A
/// tick allocates and locks nothing, unless soft tissue is solved in it.
typedef struct plp_session plp_session;

/// Pose of a device.
typedef struct plp_pose {
  uint32_t size;
  uint32_t buttons;            ///< Bit n: button n is held
  double tip_mm[3];            ///< In the session's frame
  double orientation_wxyz[4];  ///< Unit quaternion from the tool's axes to those of the session's frame
  double age_s;                ///< Age of the pose; above 5 ms the force fades out
  uint32_t status;             ///< Bits: 1 device fault, 2 clutched, 4 halted
  uint32_t reserved;           ///< 0
} plp_pose;
PLP_API plp_status plp_pose_init(plp_pose* pose, size_t size);

/// Force and torque on the hand, in the session's frame.
typedef struct plp_wrench {
  uint32_t size;
  uint32_t reserved;
  double force_N[3];
  double torque_Nmm[3];  ///< About the tip
} plp_wrench;
PLP_API plp_status plp_wrench_init(plp_wrench* wrench, size_t size);

/// One tick of one device.
typedef struct plp_record {
  uint32_t size;
  uint32_t device;
  uint64_t tick;
  uint64_t state_hash;  ///< Hash of the state of all devices after the tick
  double time_s;        ///< Sum of the durations of all earlier ticks
  double dt_s;
  uint32_t model_version;
  uint32_t flags;  ///< Bits: plp_flag
  uint32_t label;  ///< Structure in contact; 0: none
  int32_t method;  ///< plp_method
  double tip_world_mm[3];
  double orientation_world_wxyz[4];
  double force_world_N[3];
  double torque_world_Nmm[3];
  double tip_patient_mm[3];
  double proxy_patient_mm[3];  ///< Proxy: position of the tip constrained to the surfaces
  double normal_patient[3];    ///< Outward unit normal of the combined contacts; 0 in free space
  double velocity_patient_mm_s[3];
  double depth_mm;           ///< Distance from the proxy to the tip; NaN: no surface within reach
  double field;              ///< Value of a direct method's field at the tip
  double unclamped_force_N;  ///< Magnitude before the output stage
  double limit_N;
  double energy_mJ;           ///< Net energy that the operator has put into the simulation
  double damping_N_s_per_m;   ///< Added by the passivity controller
  uint32_t contact_label[6];  ///< Contacts, strongest first within a layer; label 0 ends the list
  uint32_t contact_part[6];   ///< Part of the tool: its points, then its capsules
  double contact_patient_mm[18];
  double contact_N[6];
  uint32_t path_label[6];   ///< Structures along the tip's path, outermost first; label 0 ends the list
  double path_depth_mm[6];  ///< Length of the path within each
  double path_share[6];     ///< Share of the force, 0 ... 1
} plp_record;
PLP_API plp_status plp_record_init(plp_record* record, size_t size);

typedef struct plp_session_options {
  uint32_t size;
  uint32_t devices;   ///< 1 ... 4
  int32_t frame;      ///< plp_frame of poses and wrenches
  int32_t method;     ///< plp_method that the model is prepared for
  int32_t friction;   ///< 0: off
  int32_t viscosity;  ///< 0: off
  int32_t passivity;  ///< 0: observed, not controlled
  /// Solve soft tissue synchronously within ticks, which then take milliseconds
  int32_t solve_soft_tissue;
  double max_force_N;             ///< Limit of the force
  double max_torque_Nmm;          ///< Limit of the torque; 0: no torque output
  double max_stiffness_N_per_mm;  ///< Maximum rendered stiffness; infinite: no bound
  double continuous_force_N;      ///< Rating of the device for its thermal limit; NaN: none
  double position_step_mm;        ///< Encoder step; NaN: unknown
  double slew_N_per_s;            ///< Limit of the force's rate of change
} plp_session_options;
PLP_API plp_status plp_session_options_init(plp_session_options* options, size_t size);

/// @param options  null: one device in World
PLP_API plp_status plp_session_create(const plp_model* model, const plp_session_options* options,
                                      plp_session** session);
PLP_API void plp_session_destroy(plp_session* session);
/// Advances by one tick.
/// @param poses     one for each device, each of the size of the first
/// @param dt_s      duration since the last tick; not finite or negative: PLP_BAD_INPUT, zero wrenches, and
///                  the session is unchanged
/// @param wrenches  one for each device, each of the size of the first
PLP_API plp_status plp_session_tick(plp_session* session, const plp_pose* poses, double dt_s,
                                    plp_wrench* wrenches);
/// Advances by `ticks` ticks of one duration.
/// @param poses     ticks * devices; the poses of one tick are consecutive
/// @param wrenches  ticks * devices; null: not returned
/// @param records   ticks * devices, each of the size of the first; null: not returned
PLP_API plp_status plp_session_run(plp_session* session, const plp_pose* poses, size_t ticks, double dt_s,
                                   plp_wrench* wrenches, plp_record* records);
/// Record of the last tick. Error before the first.
PLP_API plp_status plp_session_record(const plp_session* session, size_t device, plp_record* record);
/// Resets the session: time 0, no contact; the model stays.
PLP_API plp_status plp_session_reset(plp_session* session);
/// Switches to a later version of the session's model; the force is blended between the two.
PLP_API plp_status plp_session_set_model(plp_session* session, const plp_model* model);
/// Number of ticks since creation or reset, and the hash over them: equal for equal runs in every language
/// binding.
PLP_API plp_status plp_session_hash(const plp_session* session, uint64_t* ticks, uint64_t* run_hash);

// ---- runs: a simulated hand follows a script

/// A finished run of the simulated hand, in memory.
typedef struct plp_run plp_run;

typedef struct plp_run_options {
  uint32_t size;
  int32_t method;           ///< Initial plp_method
  const char* script_file;  ///< Palpation script (docs/guide/script.md); null: see script_text
  const char* script_text;  ///< Script text; null: a default script planned for the scene
  const char* recording;    ///< HDF5 file to write; null: none
  int64_t seed;             ///< Seed of the hand's tremor; -1: the script's
  double max_force_N;       ///< NaN: the lesser of the device's continuous rating and 3 N
  double rate_hz;           ///< Ticks a second; NaN: the script's
} plp_run_options;
PLP_API plp_status plp_run_options_init(plp_run_options* options, size_t size);

typedef struct plp_run_info {
  uint32_t size;
  uint32_t devices;
  uint64_t ticks;
  uint64_t run_hash;  ///< Hash over all ticks; equal to that of `palpate simulate` for equal inputs
  uint64_t failed_steps;
  double rate_hz;
  double max_force_N;  ///< Largest force
  double limit_N;
  uint64_t troubles;  ///< Number of problem messages (plp_run_trouble)
} plp_run_info;

/// Simulates a script on the virtual clock, as `palpate simulate` does. What it prepares of the model is kept
/// with the model for its next run.
/// @param options  null: the defaults
PLP_API plp_status plp_simulate(const plp_model* model, const plp_run_options* options, plp_run** run);
PLP_API plp_status plp_run_info_get(const plp_run* run, plp_run_info* info);
/// Ticks first ... first + count - 1 of a device.
/// @param records  each of the size of the first
PLP_API plp_status plp_run_records(const plp_run* run, size_t device, uint64_t first, size_t count,
                                   plp_record* records);
/// Message about a failed step or an unreachable force, valid as long as the run; null: index out of range.
PLP_API const char* plp_run_trouble(const plp_run* run, size_t index);
PLP_API void plp_run_destroy(plp_run* run);

// ---- loops: palpate ticks

/// Servo loop on its own thread. The host posts poses at any rate and reads the latest tick. A loop ignores
/// the session option `slew_N_per_s` and does not solve soft tissue.
typedef struct plp_loop plp_loop;

typedef struct plp_loop_options {
  uint32_t size;
  int32_t realtime;  ///< Request SCHED_FIFO and locked memory; if refused, it ticks without them
  const plp_session_options* session;  ///< Options of one device; null: the defaults
  double rate_hz;                      ///< 250 ... 10000
} plp_loop_options;
PLP_API plp_status plp_loop_options_init(plp_loop_options* options, size_t size);

/// @param options  null: the defaults
PLP_API plp_status plp_loop_start(const plp_model* model, const plp_loop_options* options, plp_loop** loop);
/// Sets the target pose of the tool. The loop interpolates between successive poses; a pose expires after 0.1
/// s. Call it from one thread at a time.
PLP_API plp_status plp_loop_post(plp_loop* loop, const plp_pose* pose);
/// Returns the latest tick. Callable from any thread; never delays the loop.
PLP_API plp_status plp_loop_snapshot(const plp_loop* loop, plp_record* record);
/// Continues with a later version of the loop's model. Any thread.
PLP_API plp_status plp_loop_set_model(plp_loop* loop, const plp_model* model);
/// Switches the force off permanently from the next tick on. Callable from any thread.
PLP_API plp_status plp_loop_emergency_stop(plp_loop* loop);

typedef struct plp_loop_health {
  uint32_t size;
  int32_t running;  ///< 0: it has ended
  uint64_t ticks;
  uint64_t skipped;  ///< Number of missed ticks
  double rate_hz;    ///< Measured
  double on_time;    ///< Share of the ticks that were on time, 0 ... 1
  double lateness_p99_us, compute_p99_us;
} plp_loop_health;
PLP_API plp_status plp_loop_health_get(const plp_loop* loop, plp_loop_health* health);
/// Fades the force out and ends the thread. Takes a fifth of a second.
PLP_API plp_status plp_loop_stop(plp_loop* loop);
/// Stops and frees a loop. Null: no effect.
PLP_API void plp_loop_destroy(plp_loop* loop);

// ---- recordings

/// A recording of a run (docs/reference/recording.md), opened for reading. It is parsed in a sandboxed
/// process, so that a damaged file is an error and never a crash.
typedef struct plp_recording plp_recording;

typedef struct plp_recording_info {
  uint32_t size;
  uint32_t devices;
  uint64_t ticks;
  uint64_t run_hash;    ///< 0 in an incomplete recording
  uint64_t model_hash;  ///< plp_model_info::content_hash of its model
  double rate_hz;
  const char* data_set;  ///< Valid as long as the recording
  const char* title;
  const char* script;  ///< Text
  int32_t complete;    ///< 0: the recording was interrupted
  int32_t simulated;   ///< 0: a physical device or a pointer moved the tool
} plp_recording_info;

PLP_API plp_status plp_recording_open(const char* file, plp_recording** recording);
PLP_API plp_status plp_recording_info_get(const plp_recording* recording, plp_recording_info* info);
/// Ticks first ... first + count - 1 of a device.
/// @param records  each of the size of the first
PLP_API plp_status plp_recording_records(const plp_recording* recording, size_t device, uint64_t first,
                                         size_t count, plp_record* records);
/// Reads one member of plp_record for every tick, such as "depth_mm" or "force_world_N".
/// @param column  receives count * plp_field::count numbers
PLP_API plp_status plp_recording_column(const plp_recording* recording, size_t device, const char* name,
                                        uint64_t first, size_t count, double* column);
PLP_API void plp_recording_destroy(plp_recording* recording);

// ---- descriptions of the structs, for bindings of other languages

/// A member of a struct.
typedef struct plp_field {
  uint32_t size;
  int32_t type;  ///< plp_type
  const char* name;
  uint32_t offset;  ///< Bytes from the beginning of the struct
  uint32_t count;   ///< Number of elements; 1: a scalar
} plp_field;
/// Member number `index` of a struct, e.g. "plp_record". Error beyond the last one.
PLP_API plp_status plp_struct_field(const char* name, size_t index, plp_field* field);
/// Size of a struct in the library, bytes; 0: unknown name.
PLP_API size_t plp_struct_size(const char* name);

#ifdef __cplusplus
}
#endif

#endif
