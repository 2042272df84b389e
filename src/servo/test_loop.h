#pragma once

/// The loop without a thread of its own, for tests of other rooms that give it its samples one by one.
#include "servo/loop.h"
