#pragma once
// From the daemon's types to messages.

#include "daemon/control/sequencer.h"
#include "daemon/service/lease_book.h"
#include "daemon/session/session.h"
#include "protocol/messages/control.pb.h"
#include "protocol/messages/frames.pb.h"

namespace mesorig::daemon {

v1::State ToMessage(SequencerState state);
v1::Reading ToMessage(const Reading& reading, RigTime now);
v1::LeaseStatus ToMessage(const LeaseState& lease);  // without its token
// `frames_planned` of the status' session. Ages of readings are rig time.
v1::StatusReply ToMessage(const SequencerStatus& status, uint32_t frames_planned);
// Without its number.
v1::Event ToMessage(const SequencerEvent& event, uint32_t frames_planned);
v1::FrameHeader ToMessage(const FrameRecord& record);

}  // namespace mesorig::daemon
