"""Files from untrusted sources: archives, XML with line numbers, and XML edited byte for byte."""
