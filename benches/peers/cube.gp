m=vector(l,i,eval(Str("m",i)));h=vector(l,i,eval(Str("h",i)));X=vector(l,k,eval(Str("x",2*k-2)));
work()={
  my(x=vector(l),f=vector(l+1),n=1,total=0);
  x[1]=1;
  forstep(c=l,2,-1,for(k=1,n,f[k+1]+=x[k]*m[c]);n++;for(k=2,n,x[k]+=f[k]*h[c-1]));
  for(k=1,n,total+=x[k]*X[k]);
  total^3*k2;
}
number=Map();for(i=1,#names,mapput(number,eval(names[i]),i));
listed()=terms(work());
foreach(listed(),t,print1(t[1]);factors(t[2]));
printf("%.3f %.3f\n",least(work),least(listed));
quit
