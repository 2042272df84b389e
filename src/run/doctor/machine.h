#pragma once

#include <filesystem>
#include <vector>

#include "palpate/doctor/doctor.h"
#include "palpate/servo/realtime.h"

namespace palpate {

/// @param grant  result of a thread's request for all rights
DoctorLine priority_line(const RealtimeGrant& grant, const std::string& user);
DoctorLine memory_line(const RealtimeGrant& grant, const std::string& user);
/// @param root  root of /sys and /proc
DoctorLine governor_line(const std::filesystem::path& root);
DoctorLine kernel_line(const std::filesystem::path& root);
DoctorLine timer_line(const TimerFigures& timer, bool realtime);

}  // namespace palpate
