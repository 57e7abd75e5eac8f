sql
UPDATE frame SET bytes = -1, offset = 9223372036854775807;
