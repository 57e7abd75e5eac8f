sql
UPDATE frame SET axis_rad = zeroblob(13), lamp_level = zeroblob(0), camera = camera - 3;
