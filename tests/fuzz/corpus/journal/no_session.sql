sql
DELETE FROM session; UPDATE frame SET sequence = sequence * 1000000007;
