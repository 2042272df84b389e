#pragma once

#include <filesystem>
#include <vector>

#include "palpate/doctor/doctor.h"
#include "palpate/servo/realtime.h"

namespace palpate {

/// @param grant  what a thread of ours got that asked for all
DoctorLine priority_line(const RealtimeGrant& grant, const std::string& user);
DoctorLine memory_line(const RealtimeGrant& grant, const std::string& user);
/// @param root  where /sys and /proc are
DoctorLine governor_line(const std::filesystem::path& root);
DoctorLine kernel_line(const std::filesystem::path& root);
DoctorLine timer_line(const TimerFigures& timer, bool realtime);

}  // namespace palpate
