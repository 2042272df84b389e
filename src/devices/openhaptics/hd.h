#pragma once

#include <filesystem>

#include "palpate/base/result.h"

/// The functions of HDAPI (libHD) that palpate uses, with their constants. Written from public documentation;
/// no vendor files are needed for the build.
namespace palpate::hd {

using Handle = unsigned;
inline constexpr Handle kBadHandle = 0xFFFFFFFF;
using Callback = unsigned (*)(void*);
inline constexpr unsigned kCallbackContinue = 1;
inline constexpr unsigned short kDefaultPriority = 0x7FFF;

struct ErrorInfo {
  unsigned code;
  int internal;
  Handle handle;
};
static_assert(sizeof(ErrorInfo) == 12);

// clang-format off
/// Result, name, arguments.
#define PALPATE_HD_FUNCTIONS(X)                                       \
  X(Handle, hdInitDevice, (const char*))                              \
  X(void, hdDisableDevice, (Handle))                                  \
  X(void, hdMakeCurrentDevice, (Handle))                              \
  X(void, hdBeginFrame, (Handle))                                     \
  X(void, hdEndFrame, (Handle))                                       \
  X(void, hdGetDoublev, (unsigned, double*))                          \
  X(void, hdGetIntegerv, (unsigned, int*))                            \
  X(void, hdSetDoublev, (unsigned, const double*))                    \
  X(const char*, hdGetString, (unsigned))                             \
  X(void, hdEnable, (unsigned))                                       \
  X(void, hdDisable, (unsigned))                                      \
  X(ErrorInfo, hdGetError, ())                                        \
  X(const char*, hdGetErrorString, (unsigned))                        \
  X(unsigned, hdCheckCalibration, ())                                 \
  X(void, hdUpdateCalibration, (unsigned))                            \
  X(unsigned long, hdScheduleAsynchronous, (Callback, void*, unsigned short)) \
  X(void, hdUnschedule, (unsigned long))                              \
  X(void, hdStartScheduler, ())                                       \
  X(void, hdStopScheduler, ())
// clang-format on

struct Library {
#define PALPATE_HD_MEMBER(result, name, arguments) result(*name) arguments = nullptr;
  PALPATE_HD_FUNCTIONS(PALPATE_HD_MEMBER)
#undef PALPATE_HD_MEMBER
};

/// Errors: those of load_vendor_library().
Result<Library> load(const std::filesystem::path& file);

enum Parameter : unsigned {
  kButtons = 0x2000,
  kPosition = 0x2050,
  kVelocity = 0x2051,
  kTransform = 0x2052,
  kAngularVelocity = 0x2053,
  kModelType = 0x2501,
  kSerialNumber = 0x2504,
  kUsableWorkspace = 0x2551,
  kCalibrationStyle = 0x2555,
  kUpdateRate = 0x2600,
  kMaxStiffness = 0x2602,
  kMaxForce = 0x2603,
  kMaxContinuousForce = 0x2604,
  kForce = 0x2700,
};
enum Capability : unsigned { kForceOutput = 0x4000, kMaxForceClamping = 0x4001, kForceRamping = 0x4002 };
enum Calibration : unsigned { kCalibrated = 0x5000, kNeedsUpdate = 0x5001, kNeedsManualInput = 0x5002 };
enum CalibrationStyle : int { kEncoderReset = 1, kAuto = 2, kInkwell = 4 };
enum ErrorCode : unsigned {
  kNoError = 0,
  kWarmMotors = 0x200,
  kExceededForce = 0x201,
  kExceededImpulse = 0x202,
  kExceededVelocity = 0x203,
  kForceError = 0x204,
  kLicence = 0x600,
};

}  // namespace palpate::hd
