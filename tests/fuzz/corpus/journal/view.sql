sql
DROP TABLE session; CREATE VIEW session AS SELECT 1 AS only, camera AS id, digest AS reason FROM frame;
