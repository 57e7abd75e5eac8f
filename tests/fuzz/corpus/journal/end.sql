sql
UPDATE session SET end = 7, frames_planned = -1, wall_s = 1e999;
