#include "daemon/service/convert.h"

#include <algorithm>

namespace mesorig::daemon {

v1::State ToMessage(SequencerState state) {
  switch (state) {
    case SequencerState::kIdle:
      return v1::IDLE;
    case SequencerState::kRunning:
      return v1::RUNNING;
    case SequencerState::kWaiting:
      return v1::WAITING;
    case SequencerState::kStopping:
      return v1::STOPPING;
    case SequencerState::kArmed:
      return v1::ARMED;
    case SequencerState::kPausing:
      return v1::PAUSING;
    case SequencerState::kPaused:
      return v1::PAUSED;
    case SequencerState::kFault:
      return v1::FAULT;
  }
  return v1::STATE_UNSPECIFIED;
}

v1::Prompt ToMessage(const OperatorPrompt& prompt) {
  v1::Prompt out;
  out.set_id(prompt.id);
  out.set_text(prompt.text);
  out.set_mount(prompt.mount);
  out.set_acknowledged(prompt.acknowledged);
  out.set_door_cycled(prompt.door_cycled);
  out.set_reset(prompt.reset);
  return out;
}

v1::Reading ToMessage(const Reading& reading, RigTime now) {
  v1::Reading out;
  out.set_name(reading.name);
  out.set_value(reading.value);
  out.set_unit(reading.unit);
  out.set_age_s(std::max(0.0, Seconds(now - reading.read_at)));
  out.set_source(reading.source == ReadingSource::kCommanded ? v1::COMMANDED : v1::READ_BACK);
  return out;
}

v1::LeaseStatus ToMessage(const LeaseState& lease) {
  v1::LeaseStatus out;
  switch (lease.kind) {
    case LeaseState::Kind::kFree:
      out.set_kind(v1::LEASE_FREE);
      break;
    case LeaseState::Kind::kManual:
      out.set_kind(v1::LEASE_MANUAL);
      break;
    case LeaseState::Kind::kRun:
      out.set_kind(v1::LEASE_RUN);
      break;
  }
  out.set_holder(lease.holder);
  out.set_left_s(lease.left_s);
  out.set_requested_by(lease.requested_by);
  return out;
}

v1::StatusReply ToMessage(const SequencerStatus& status, uint32_t frames_planned) {
  v1::StatusReply reply;
  reply.set_state(ToMessage(status.state));
  reply.set_session_id(status.session_id);
  reply.set_shots_done(status.shots_done);
  reply.set_shots(status.shots);
  reply.set_frames_durable(status.frames_durable);
  reply.set_frames(frames_planned);
  reply.set_rig_s(status.rig_s);
  reply.set_estimated_s(status.estimated_s);
  reply.set_message(status.message);
  reply.set_deterministic(status.deterministic);
  reply.set_bytes_left(status.bytes_left);
  reply.set_remaining_s(status.remaining_s);
  reply.set_alarms(status.alarms);
  reply.set_storage(status.storage);
  reply.set_frames_late(status.trouble.late);
  reply.set_frames_lost(status.trouble.lost);
  reply.set_frames_refused(status.trouble.refused);
  reply.set_frames_queued(status.frames_queued);
  reply.set_frames_verified(status.frames_verified);
  if (status.prompt) *reply.mutable_prompt() = ToMessage(*status.prompt);
  for (const Reading& reading : status.readings) {
    *reply.add_readings() = ToMessage(reading, status.now);
  }
  return reply;
}

v1::Event ToMessage(const SequencerEvent& event, uint32_t frames_planned) {
  const SequencerStatus& status = event.status;
  v1::Event out;
  out.set_rig_s(status.rig_s);
  switch (event.kind) {
    case SequencerEvent::Kind::kState:
      out.mutable_state()->set_state(ToMessage(status.state));
      out.mutable_state()->set_reason(event.text);
      break;
    case SequencerEvent::Kind::kStarted:
      out.mutable_started()->set_session_id(status.session_id);
      out.mutable_started()->set_shots(status.shots);
      out.mutable_started()->set_frames(frames_planned);
      out.mutable_started()->set_resumed(event.resumed);
      break;
    case SequencerEvent::Kind::kProgress:
      out.mutable_progress()->set_session_id(status.session_id);
      out.mutable_progress()->set_shots_done(status.shots_done);
      out.mutable_progress()->set_frames_durable(status.frames_durable);
      break;
    case SequencerEvent::Kind::kEnded: {
      v1::SessionEnded& ended = *out.mutable_ended();
      ended.set_session_id(status.session_id);
      ended.set_complete(event.complete);
      if (!event.complete) ended.set_reason(event.text);
      ended.set_frames_durable(status.frames_durable);
      ended.set_virtual_s(event.virtual_s);
      ended.set_wall_s(event.wall_s);
      ended.set_deterministic(status.deterministic);
      ended.set_preparation_s(event.preparation_s);
      break;
    }
    case SequencerEvent::Kind::kPrompt:
      if (status.prompt) *out.mutable_prompt() = ToMessage(*status.prompt);
      break;
    case SequencerEvent::Kind::kAlarm:
      out.mutable_alarm()->set_session_id(status.session_id);
      out.mutable_alarm()->set_camera(event.camera);
      out.mutable_alarm()->set_text(event.text);
      break;
    case SequencerEvent::Kind::kNote:
      out.set_note(event.text);
      break;
  }
  return out;
}

v1::FrameHeader ToMessage(const FrameRecord& record) {
  v1::FrameHeader header;
  header.set_sequence(record.sequence);
  header.set_camera(static_cast<uint32_t>(record.camera));
  header.set_shot(record.shot);
  header.set_frame_id(record.frame_id);
  header.set_supersedes(record.supersedes);
  header.set_exposure_start_ns(record.exposure_start_ns);
  header.set_exposure_end_ns(record.exposure_end_ns);
  header.set_exposure_s(record.exposure_s);
  header.mutable_axis_rad()->Add(record.axis_rad.begin(), record.axis_rad.end());
  header.mutable_lamp_level()->Add(record.lamp_level.begin(), record.lamp_level.end());
  header.set_width(static_cast<uint32_t>(record.width));
  header.set_height(static_cast<uint32_t>(record.height));
  header.set_bits(static_cast<uint32_t>(record.bits));
  header.set_digest(record.digest);
  header.set_region_x(static_cast<uint32_t>(record.region_x));
  header.set_region_y(static_cast<uint32_t>(record.region_y));
  if (record.laser) {
    v1::LaserState& laser = *header.mutable_laser();
    laser.set_sweep(record.laser->sweep);
    laser.set_index(record.laser->index);
    laser.set_mount(static_cast<uint32_t>(record.laser->mount));
    laser.set_tilt_rad(record.laser->tilt_rad);
    laser.set_on(record.laser->on);
  }
  return header;
}

}  // namespace mesorig::daemon
