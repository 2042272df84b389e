#pragma once

#include <filesystem>

#include "palpate/base/result.h"

/// The functions of Force Dimension's library that palpate uses, with their constants. Written from public
/// documentation; no vendor files are needed for the build.
namespace palpate::dhd {

// clang-format off
/// Result, name, arguments. `char` is the device id.
#define PALPATE_DHD_NEEDED(X)                                                                            \
  X(int, dhdGetDeviceCount, ())                                                                          \
  X(int, dhdOpenID, (char))                                                                              \
  X(int, dhdClose, (char))                                                                               \
  X(int, dhdGetSystemType, (char))                                                                       \
  X(int, dhdGetPositionAndOrientationFrame, (double*, double*, double*, double (*)[3], char))            \
  X(int, dhdGetLinearVelocity, (double*, double*, double*, char))                                        \
  X(int, dhdGetGripperAngleRad, (double*, char))                                                         \
  X(unsigned, dhdGetButtonMask, (char))                                                                  \
  X(int, dhdEnableForce, (unsigned char, char))                                                          \
  X(int, dhdStop, (char))                                                                                \
  X(int, dhdSetForceAndTorqueAndGripperForce, (double, double, double, double, double, double, double, char)) \
  X(int, dhdSetMaxForce, (double, char))                                                                 \
  X(double, dhdGetMaxForce, (char))                                                                      \
  X(int, dhdGetStatus, (int*, char))                                                                     \
  X(const char*, dhdErrorGetLastStr, ())                                                                 \
  X(void, dhdGetSDKVersion, (int*, int*, int*, int*))                                                    \
  X(bool, dhdHasActiveWrist, (char))                                                                     \
  X(bool, dhdHasActiveGripper, (char))                                                                   \
  X(bool, dhdIsLeftHanded, (char))
/// Functions that only libdrd has, or that older versions lack.
#define PALPATE_DHD_OPTIONAL(X)                                                                          \
  X(int, drdOpenID, (char))                                                                              \
  X(int, drdClose, (char))                                                                               \
  X(bool, drdIsInitialized, (char))                                                                      \
  X(int, drdAutoInit, (char))                                                                            \
  X(int, drdStop, (bool, char))                                                                          \
  X(int, dhdSetGravityCompensation, (int, char))                                                         \
  X(int, dhdSetEffectorMass, (double, char))                                                             \
  X(int, dhdGetSerialNumber, (unsigned short*, char))
// clang-format on

struct Library {
#define PALPATE_DHD_MEMBER(result, name, arguments) result(*name) arguments = nullptr;
  PALPATE_DHD_NEEDED(PALPATE_DHD_MEMBER)
  PALPATE_DHD_OPTIONAL(PALPATE_DHD_MEMBER)
#undef PALPATE_DHD_MEMBER

  /// Whether the library supports initialising arms and querying it.
  bool initialises() const {
    return drdOpenID && drdClose && drdIsInitialized && drdAutoInit && drdStop;
  }
};

/// Errors: those of load_vendor_library().
Result<Library> load(const std::filesystem::path& file);

/// Positive return value; any negative one is a failure.
inline constexpr int kTimeGuard = 1;  ///< The returned state is an old one

/// Results of dhdGetSystemType.
enum Type : int {
  kOmega3 = 33,
  kOmega6 = 34,
  kOmega7 = 35,
  kOmega6Left = 36,
  kOmega7Left = 37,
  kFalcon = 60,
  kDelta3 = 63,
  kDelta6 = 64,
  kSigma7 = 104,
  kSigma7Left = 105,
};

/// Indices into the array that dhdGetStatus fills.
enum Status : int { kPower, kConnected, kStarted, kReset, kIdle, kForce, kError = 9, kForceOffCause = 14 };
inline constexpr int kStatusFields = 64;  ///< 17 in version 3.17; newer ones have more
/// Reasons for disabled forces.
enum OffCause : int {
  kByButton = 1,
  kByVelocity = 2,
  kByWatchdog = 3,
  kBySoftware = 4,
  kByUsb = 5,
  kByDeadman = 6,
};

}  // namespace palpate::dhd
