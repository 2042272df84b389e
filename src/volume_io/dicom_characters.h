#pragma once

#include <optional>
#include <string>
#include <string_view>

/// Texts of DICOM files in the character sets of PS3.3 C.12.1.1.2, single-byte sets, GB18030, GBK and those
/// that ISO 2022 switches between (PS3.5 6.1) included. The bytes are untrusted.
namespace palpate::volume_io {

/// @param text  as it stands in the file, values between backslashes
/// @param set   the file's SpecificCharacterSet (0008,0005), values between backslashes
/// @return nothing where the set is unknown or the text is none of it
std::optional<std::string> dicom_text_in_utf8(std::string_view text, std::string_view set);

}  // namespace palpate::volume_io
